"""Runs side by side in a report: log-odds by hand, pruned classes, model doubt and coverage, wrong usage."""

import dataclasses
import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from worlds.belief_factory import CLASSES, run_configuration, small_belief, write_belief_bag, write_rows

from semantic_slam.cli import bag_to_report
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.messages import topics
from semantic_slam.report.log_odds import log_class_probabilities, log_odds, top_two
from semantic_slam.report.make import make_report
from semantic_slam.report.shown.comparison_view import RUN_KINDS

KEYFRAMES = 9
OBJECT = 3


def belief(keyframe: int, weights: list[float], classes: list[int]) -> HybridBelief:
    """One object, seen by one detection; hypothesis h says class ``classes[h]``."""
    ids, count = [10 * keyframe + h for h in range(len(weights))], len(weights)
    parents = [10 * (keyframe - 1)] * count if keyframe else ids
    plain = small_belief(keyframe, ids, parents, weights, [OBJECT], [[0]] * count)
    one_hot = np.eye(len(CLASSES))[classes][:, None, :]
    marginal = np.einsum("h,hoc->oc", np.array(weights), one_hot)
    return dataclasses.replace(plain, hypothesis_class_probabilities=one_hot, class_probabilities=marginal)


def write(folder: Path, beliefs: list[HybridBelief]) -> Path:
    run = run_configuration(folder / "source", CLASSES, ("",) * 7)
    write_rows(folder, [(topics.RUN_CONFIGURATION, 1, run), *((topics.BELIEF, b.stamp_ns, b) for b in beliefs)])
    return folder


def sure(keyframe: int, odds: float) -> HybridBelief:
    """Crate against desk, ``odds`` to 1."""
    return belief(keyframe, [odds / (1 + odds), 1 / (1 + odds)], [0, 2])


@pytest.fixture
def made(tmp_path: Path) -> Path:
    """The main run stays at 3 to 1; the other one doubles its odds with every view and prunes at keyframe 7."""
    main = write(tmp_path / "main", [sure(k, 3.0) for k in range(KEYFRAMES)])
    doubling = [sure(k, 2.0**k) if k < 7 else belief(k, [1.0], [0]) for k in range(KEYFRAMES)]
    other = write(tmp_path / "other", doubling)
    make_report(main, tmp_path / "report", name="steady", compared={"doubling": other})
    return tmp_path / "report"


def test_log_odds_are_known_where_probabilities_are_one() -> None:
    """Weights e^-800 and 1: the probabilities are 0 and 1 in double precision, the log-odds are 800 nats."""
    plain = belief(0, [0.5, 0.5], [0, 2])
    far = dataclasses.replace(plain, log_weights=np.array([0.0, -800.0]))
    assert log_odds([far], OBJECT, ("crate", "desk")) == pytest.approx([800.0])
    assert log_odds([far], OBJECT, ("desk", "crate")) == pytest.approx([-800.0])
    assert np.exp(log_class_probabilities(plain, OBJECT)) == pytest.approx([0.5, 0.0, 0.5])


def test_the_pair_is_the_last_one_with_two_classes() -> None:
    beliefs = [belief(0, [0.6, 0.3, 0.1], [2, 1, 0]), belief(1, [1.0], [2])]
    assert top_two(beliefs, OBJECT) == ("desk", "chest")
    assert top_two(beliefs[1:], OBJECT) is None
    assert log_odds(beliefs, OBJECT, ("desk", "chest")) == pytest.approx([math.log(2.0), math.inf])
    assert np.isnan(log_odds(beliefs, OBJECT, ("desk", "sofa"))).all()
    assert np.isnan(log_odds(beliefs, 99, ("desk", "chest"))).all()


def test_comparisons_in_report_json(made: Path) -> None:
    steady, doubling = json.loads((made / "report.json").read_text())["comparisons"]
    assert (steady["name"], doubling["name"]) == ("steady", "doubling")
    first, second = steady["objects"][0], doubling["objects"][0]
    assert first["id"] == second["id"] == OBJECT and first["classes"] == second["classes"] == ["crate", "desk"]
    assert first["log_odds"] == pytest.approx([math.log(3.0)] * KEYFRAMES)
    assert second["log_odds"][:7] == pytest.approx([k * math.log(2.0) for k in range(7)])
    assert second["log_odds"][7:] == [None, None] and second["pruned_at_keyframe"] == 7
    assert first["change_since_view_5"] == pytest.approx(0.0) and first["pruned_at_keyframe"] is None
    assert first["view_5_keyframe"] == 4 and second["change_since_view_5"] is None
    assert second["class_probabilities"] == {"crate": 1.0, "chest": 0.0, "desk": 0.0}
    assert steady["keyframes"] == list(range(KEYFRAMES)) and len(steady["association_entropy"]) == KEYFRAMES
    assert set(steady["config"]) == set(doubling["config"])


def test_the_page_shows_both_runs(made: Path) -> None:
    text = (made / "report.html").read_text()
    assert "Runs side by side" in text and "crate or desk" in text
    assert "pruned at keyframe 7" in text
    assert "change by 0.00 nats with steady and beyond measure with doubling (pruned at keyframe 7)." in text
    chart = text[text.index("crate or desk") :]
    chart = chart[: chart.index("</figure>")]
    assert chart.count("<polyline") == 2


def test_a_run_alone_has_no_comparison(tmp_path: Path) -> None:
    beliefs, _ = write_belief_bag(tmp_path, 3)
    make_report(beliefs, tmp_path / "report")
    assert json.loads((tmp_path / "report" / "report.json").read_text())["comparisons"] == []
    assert "Runs side by side" not in (tmp_path / "report" / "report.html").read_text()


def test_names_of_runs_are_text(tmp_path: Path) -> None:
    main = write(tmp_path / "main", [sure(k, 3.0) for k in range(6)])
    make_report(main, tmp_path / "report", name="<b>one</b>", compared={"<script>two": main})
    text = (tmp_path / "report" / "report.html").read_text()
    assert "<script>two" not in text and "&lt;script&gt;two" in text and "<b>one</b>" not in text


def test_model_doubt_and_coverage_of_each_object(tmp_path: Path) -> None:
    plain = [sure(k, 3.0) for k in range(4)]
    doubtful = [
        dataclasses.replace(b, mutual_information=np.array([0.25]), in_coverage=np.array([False])) for b in plain
    ]
    texts = []
    for name, beliefs in (("plain", plain), ("doubtful", doubtful)):
        make_report(write(tmp_path / name, beliefs), tmp_path / f"report_{name}")
        texts.append((tmp_path / f"report_{name}" / "report.html").read_text())
    assert "model doubt, up to" not in texts[0] and "model doubt, up to 0.25 nats" in texts[1]
    assert '<b class="bad">no</b>' not in texts[0] and '<b class="bad">no</b>' in texts[1]


def test_wrong_usage_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    def fault(*words: str) -> str:
        monkeypatch.setattr(sys, "argv", ["bag_to_report", str(tmp_path), "--out", str(tmp_path / "out"), *words])
        with pytest.raises(SystemExit) as left:
            bag_to_report.main()
        assert left.value.code == 2
        (line,) = capsys.readouterr().err.splitlines()
        return line

    assert "a.yaml: two configurations have that name" in fault("--compare", "x/a.yaml", "--compare", "y/a.yaml")
    assert "default.yaml: two configurations" in fault("--compare", "mine/default.yaml")
    assert "at most 4" in fault(*[word for n in range(5) for word in ("--compare", f"{n}.yaml")])


def test_every_run_that_is_allowed_has_a_line_of_its_own() -> None:
    assert len(set(RUN_KINDS)) == len(RUN_KINDS) == bag_to_report.MOST_COMPARED + 1
