"""``semantic_slam explain`` on belief bags: three sentences and tables, or one line with a remedy."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from worlds.bags.bag_factory import of_topic, write_bag
from worlds.bags.places import place_entries

from semantic_slam.answers.explain.explanation import explain
from semantic_slam.cli.commands import main
from semantic_slam.configuration import Configuration
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message, to_message
from semantic_slam.pipeline.offline import run_bag

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report's folder with the belief of a drive past a chair and a cup, and an input bag beside it."""
    out = tmp_path_factory.mktemp("explain")
    entries = place_entries("ranges", 6)
    for entry in of_topic(entries, topics.DETECTIONS):
        found = from_message(entry.message)
        entry.message = to_message(replace(found, labels=("chair", "cup")))
    settings = Configuration.of(association="open", semantic_model={"kind": "detector"})
    run_bag(write_bag(out / "input", entries), out / "report" / "belief", settings)
    return out


def call(monkeypatch: pytest.MonkeyPatch, *words: object) -> int:
    monkeypatch.setattr("sys.argv", ["semantic_slam", "explain", *map(str, words)])
    with pytest.raises(SystemExit) as left:
        main()
    assert isinstance(left.value.code, int)
    return left.value.code


def test_explain_prints_three_sentences_and_tables(folder, monkeypatch, capsys):
    assert call(monkeypatch, folder / "report", "--object", 1, "--classes", "chair", "cup") == 0
    told = capsys.readouterr().out
    sentences, views, histories, *_, last = told.split("\n\n")
    assert len(sentences.splitlines()) == 3 and all(line.endswith(".") for line in sentences.splitlines())
    header, prior, *rows, revised, total = views.splitlines()
    assert "chair:cup" in header and prior.startswith("prior") and revised.startswith("earlier views revised")
    nats = [float(line.split()[at]) for line, at in ((prior, 1), *((row, 3) for row in rows), (revised, 3))]
    assert len(rows) == 6 and sum(nats) == pytest.approx(float(total.split()[-1]), abs=0.01)
    assert histories.splitlines()[-1].startswith("belief")
    assert last.startswith("The replay reproduces the recorded beliefs")


def test_from_python_a_reports_folder_is_its_belief_bag(folder):
    report, bag = folder / "report", folder / "report" / "belief"
    assert [len(read_record(path).beliefs) for path in (report, str(report), bag)] == [6] * 3
    by_folder, by_bag = (explain(path, "1") for path in (str(report), bag))
    np.testing.assert_array_equal(by_folder.belief.class_probabilities, by_bag.belief.class_probabilities)


def test_the_json_of_explain_has_an_account_of_every_class_to_the_last_digit(folder, monkeypatch, capsys):
    assert call(monkeypatch, folder / "report" / "belief", "--object", 1, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["class_names"][0] == "chair" and told["largest_difference_nats"] < 1e-6
    (best, *_), names = told["histories"], told["class_names"]
    probabilities = dict(zip(names, best["class_probabilities"], strict=True))
    assert len(best["pairs"]) == len(names) - 1 and len(best["views"]) == 6
    for pair in best["pairs"]:
        one, other = (probabilities[name] for name in pair["classes"])
        total = pair["prior"] + sum(pair["nats"].values()) + pair["revised"]
        assert total == pytest.approx(np.log(one / other), abs=1e-6) == pair["log_odds"]


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (("report", "--object", "lamp"), "the map has no object 'lamp'; ask for one of 1 (box 1), 2 (box 2)"),
        (
            ("report", "--object", 1, "--classes", "chair", "sofa"),
            "'sofa' is no class of the map, which knows chair, cup",
        ),
        (("report", "--object", 1, "--classes", "cup", "cup"), "'cup' is compared with itself; name two classes"),
        (("report", "--object", 1, "--history", 0), "--history 0: must be at least 1"),
        (("report", "--object", 1, "--history", 99), "--history 99: the last belief has"),
        (("input", "--object", 1), "input --out DIR first, and give DIR"),
        (("nowhere", "--object", 1), "nowhere"),
        (("report",), "--object"),
    ],
)
def test_what_cannot_be_explained_is_one_line_with_a_remedy(words, fault, folder, monkeypatch, capsys):
    assert call(monkeypatch, folder / words[0], *words[1:]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert fault in line
