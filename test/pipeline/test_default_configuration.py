"""Who names no configuration gets the one that their detector's labels ask for."""

from pathlib import Path

import pytest
from worlds.bags.bag_factory import Entry, input_entries, of_topic, write_bag
from worlds.bags.places import place_entries
from worlds.processes.installed import ROOT

from semantic_slam.messages import topics
from semantic_slam.pipeline.default_configuration import configuration_for
from semantic_slam.shipped import CONFIGURATIONS, DEFAULT_CONFIGURATION

DETECTOR = CONFIGURATIONS / "detector.yaml"


def labelled(entries: list[Entry], label: str) -> list[Entry]:
    for entry in of_topic(entries, topics.DETECTIONS):
        entry.message.labels = [label] * len(entry.message.labels)
    return entries


def test_the_shipped_bag_is_run_with_the_default(capsys: pytest.CaptureFixture[str]) -> None:
    assert configuration_for(ROOT / "bags" / "aliased_room") == DEFAULT_CONFIGURATION
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("label", "chosen"),
    [("refrigerator", DETECTOR), ("cabinet", DEFAULT_CONFIGURATION), ("", DEFAULT_CONFIGURATION)],
)
def test_labels_that_are_no_classes_of_the_default_choose_the_detectors(
    label: str, chosen: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_bag(tmp_path / "bag", labelled(input_entries(2), label))
    assert configuration_for(bag) == chosen
    said = capsys.readouterr().out.splitlines()
    assert len(said) == (chosen == DETECTOR)
    assert all(f"labels ({label})" in line and "config/detector.yaml" in line for line in said)


def test_places_alone_are_found_on_a_map_whatever_they_are_called(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", labelled(place_entries("ranges"), "landmark"))
    assert configuration_for(bag) == DEFAULT_CONFIGURATION
    (bag / "objects.json").unlink()
    assert configuration_for(bag) == DETECTOR
    assert configuration_for(bag, has_map=True) == DEFAULT_CONFIGURATION
