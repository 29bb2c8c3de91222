"""``semantic_slam map``: a run's map is saved, shown, compared and merged, and a later run starts from it."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from semantic_slam_lab.fuzz import small_drive

from semantic_slam.cli.commands import main
from semantic_slam.configuration import from_dict
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.maps.from_belief import saved_map_of_belief
from semantic_slam.maps.map_file import read_map, read_map_prior, write_map
from semantic_slam.pipeline.offline import run_bag

PLAIN = from_dict(small_drive.PLAIN)


@pytest.fixture
def belief(tmp_path: Path) -> Path:
    """The belief bag of a small run."""
    bag = small_drive.write(tmp_path / "bag", small_drive.items(), small_drive.map_prior())
    return run_bag(bag, tmp_path / "belief", PLAIN).belief_bag


def called(monkeypatch: pytest.MonkeyPatch, *words: str | Path) -> int:
    monkeypatch.setattr(sys, "argv", ["semantic_slam", "map", *map(str, words)])
    with pytest.raises(SystemExit) as left:
        main()
    assert isinstance(left.value.code, int)
    return left.value.code


def test_a_map_is_saved_shown_and_compared(
    belief: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    place, prior = tmp_path / "room.map", tmp_path / "bag" / "objects.json"
    assert called(monkeypatch, "save", belief, "--out", place) == 0
    known = read_map(place)
    assert known.map_id in capsys.readouterr().out and known.has_cross_covariances
    assert called(monkeypatch, "save", belief, "--out", place) == 2
    assert "give --overwrite" in capsys.readouterr().err
    assert called(monkeypatch, "show", place, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["provenance"]["started_from"] == read_map(prior).map_id
    assert [own["sightings"] for own in told["objects"]] == [4.0, 4.0]
    assert called(monkeypatch, "show", prior) == 0
    assert "each object by itself" in capsys.readouterr().out
    assert called(monkeypatch, "diff", prior, place) == 0
    assert capsys.readouterr().out.count("\nsame ") == 2
    assert called(monkeypatch, "merge", place, prior, "--out", tmp_path / "both.map") == 2
    assert "holds what that one knows" in capsys.readouterr().err


def test_maps_of_two_keyframes_of_one_run_are_not_merged(
    belief: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """By what ``~/save_map`` writes during a run: the bag tells the recording, of a live run its first stamp does."""
    record = read_record(belief)
    for source in (record.run.source, ""):
        run, places = replace(record.run, source=source), (tmp_path / "early.map", tmp_path / "late.map")
        write_map(places[0], saved_map_of_belief(record.beliefs[-2], run))
        late = write_map(places[1], saved_map_of_belief(record.beliefs[-1], run))
        assert called(monkeypatch, "merge", *places, "--out", tmp_path / "both.map") == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert "are of one recording" in line and f"use the later one, {late.map_id}, alone" in line
        assert read_map(places[0]).provenance.began_ns == record.run.stamp_ns > 0


def test_the_next_run_starts_from_the_file(belief: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place, marginals = tmp_path / "room.map", tmp_path / "marginals.map"
    assert called(monkeypatch, "save", belief, "--out", place) == 0
    assert called(monkeypatch, "save", belief, "--out", marginals, "--marginals") == 0
    assert not read_map(marginals).has_cross_covariances
    later = run_bag(tmp_path / "bag", tmp_path / "later", PLAIN, read_map_prior(place)).belief_bag
    assert called(monkeypatch, "save", later, "--out", tmp_path / "later.map") == 0
    assert read_map(tmp_path / "later.map").provenance.started_from == read_map(place).map_id


def test_a_map_that_is_none_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "other.map").write_bytes(b"\0" * 64)
    for words in (("show", tmp_path / "other.map"), ("diff", tmp_path / "none.map", tmp_path / "other.map")):
        assert called(monkeypatch, *words) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1
