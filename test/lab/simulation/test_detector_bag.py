"""A foreign bag with a detector's names, by the two commands that a user types: every object is called what it is."""

import json
import sys
from pathlib import Path

import pytest
from worlds.bags.imported import run_import
from worlds.processes.installed import ROOT

from semantic_slam.bag.reader import BagReader
from semantic_slam.cli import bag_to_report
from semantic_slam.messages.codec import from_message

pytest.importorskip("semantic_slam_lab")

from semantic_slam_lab.simulation.detectors.detector_bag import write_detector_bag
from semantic_slam_lab.simulation.detectors.detector_words import NAMES, DetectorFaults

ROOM = ROOT / "bags" / "aliased_room"


@pytest.mark.long
@pytest.mark.slow
def test_eight_objects_have_the_right_name_and_nothing_else_exists(tmp_path: Path, monkeypatch, capsys) -> None:
    write_detector_bag(ROOM, tmp_path / "foreign", DetectorFaults(), seed=1)
    run_import(monkeypatch, "bag", tmp_path / "foreign", "--out", tmp_path / "bag")
    words = ["bag_to_report", tmp_path / "bag", "--out", tmp_path / "out"]
    monkeypatch.setattr(sys, "argv", list(map(str, words)))
    with pytest.raises(SystemExit) as left:
        bag_to_report.main()
    assert not left.value.code
    assert "using config/detector.yaml" in capsys.readouterr().out
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    objects = [item["class_probabilities"] for item in report["objects"] if item["existence"] > 0.5]
    assert len(objects) == 8 and min(max(own.values()) for own in objects) > 0.9
    told = sorted(max(own, key=own.get) for own in objects)
    assert told == sorted(NAMES[name] for name in _true_classes())
    assert report["metrics"]["class_nll"] < 0.05


def _true_classes() -> tuple[str, ...]:
    with BagReader(ROOM) as reader:
        (message,) = reader.messages(["/ground_truth/objects"])
        return from_message(reader.decode(message.cdr, message.type_name)).class_names
