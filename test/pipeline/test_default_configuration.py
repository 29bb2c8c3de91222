"""Who names no configuration gets the one that the labels of their detector and of their map ask for."""

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from worlds.bags.bag_factory import Entry, input_entries, map_prior, of_topic, write_bag
from worlds.bags.places import named_entries, place_entries
from worlds.processes.installed import ROOT

from semantic_slam.cli import bag_to_report
from semantic_slam.errors import InputError
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.messages import topics
from semantic_slam.pipeline.default_configuration import configuration_for
from semantic_slam.shipped import CONFIGURATIONS, DEFAULT_CONFIGURATION

DETECTOR, SECOND_SESSION = CONFIGURATIONS / "detector.yaml", CONFIGURATIONS / "detector_second_session.yaml"
ROOM = {"chair": (2.5, 0.6), "cup": (3.0, -0.7), "lamp": (3.6, 0.2), "sofa": (3.3, -1.4)}
FIVE = ("cabinet", "chest", "crate", "desk", "locker")
GONE, NEW = "cup", {"plant": (2.8, 1.3)}
FRAMES = 15


@pytest.fixture
def report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., dict[int, dict[str, Any]]]:
    """Runs the command and returns the objects of its report by number."""

    def run(bag: Path, *words: str | Path) -> dict[int, dict[str, Any]]:
        out = tmp_path / f"out_{bag.name}"
        monkeypatch.setattr(sys, "argv", ["report", *map(str, (bag, "--out", out, *words))])
        bag_to_report.command()
        return {item["id"]: item for item in json.loads((out / "report.json").read_text())["objects"]}

    return run


def without_map(path: Path, entries: list[Entry]) -> Path:
    bag = write_bag(path, entries)
    (bag / "objects.json").unlink()
    return bag


def labelled(entries: list[Entry], label: str) -> list[Entry]:
    for entry in of_topic(entries, topics.DETECTIONS):
        entry.message.labels = [label] * len(entry.message.labels)
    return entries


def of_class(name: str) -> MapPrior:
    """A map with two objects of a class."""
    prior = map_prior()
    return replace(prior, objects=tuple(replace(item, class_probabilities={name: 1.0}) for item in prior.objects))


def map_file(path: Path, name: str) -> Path:
    path.write_text(of_class(name).to_json())
    return path


def names(objects: dict[int, dict[str, Any]]) -> dict[int, str]:
    """Likeliest classes of the objects that exist, by number."""
    classes = {number: item["class_probabilities"] for number, item in objects.items() if item["existence"] > 0.9}
    return {number: max(own, key=own.__getitem__) for number, own in classes.items()}


def test_a_second_visit_with_a_detectors_labels_keeps_the_objects_and_knows_what_left_and_what_came(
    report: Callable[..., dict[int, dict[str, Any]]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = names(report(without_map(tmp_path / "first", named_entries(ROOM, FRAMES))))
    assert "using config/detector.yaml" in capsys.readouterr().out
    assert sorted(first.values()) == sorted(ROOM)
    later = {name: place for name, place in ROOM.items() if name != GONE} | NEW
    bag = without_map(tmp_path / "second", named_entries(later, FRAMES))
    second = report(bag, "--map-prior", tmp_path / "out_first" / "objects.json")
    assert "using config/detector_second_session.yaml" in capsys.readouterr().out
    (gone,) = [number for number, name in first.items() if name == GONE]
    assert second[gone]["existence"] < 0.01 and second[gone]["missing"] > 0.99
    found = names(second)
    assert {number: found[number] for number in first if number != gone} == {
        number: name for number, name in first.items() if number != gone
    }
    assert [name for number, name in found.items() if number not in first] == [*NEW]


@pytest.mark.long
def test_a_second_visit_may_begin_lost_on_the_map(
    report: Callable[..., dict[int, dict[str, Any]]], tmp_path: Path
) -> None:
    first = names(report(without_map(tmp_path / "first", named_entries(ROOM, FRAMES))))
    bag, lost = without_map(tmp_path / "second", named_entries(ROOM, FRAMES)), tmp_path / "lost.yaml"
    start, shipped = "  ros__parameters:\n", SECOND_SESSION.read_text()
    lost.write_text(
        shipped.replace(start, f"{start}    initial_pose: {{mean: [3.0, -2.0, 1.0], sigma: [10, 10, 3.2]}}\n")
    )
    words = ["--map-prior", tmp_path / "out_first" / "objects.json", "--config", lost]
    assert names(report(bag, *words)) == first


def test_what_the_default_would_say_of_that_map_names_the_remedy(
    report: Callable[..., dict[int, dict[str, Any]]], tmp_path: Path
) -> None:
    bag = without_map(tmp_path / "bag", named_entries(ROOM, 2))
    words = ["--map-prior", map_file(tmp_path / "objects.json", "chair"), "--config", DEFAULT_CONFIGURATION]
    with pytest.raises(InputError, match=r"unknown class 'chair'.*config/detector_second_session\.yaml") as told:
        report(bag, *words)
    assert len(str(told.value).splitlines()) == 1
    (tmp_path / "listed.yaml").write_text("{association: open, semantic_model: {kind: detector, labels: [cup]}}")
    with pytest.raises(InputError, match=r"unknown class 'chair'.*add it to semantic_model\.labels"):
        report(bag, *words[:-1], tmp_path / "listed.yaml")


def test_places_alone_are_found_on_a_map_whatever_they_are_called(
    report: Callable[..., dict[int, dict[str, Any]]], tmp_path: Path
) -> None:
    """On a map of other words, and on one without classes; where they have no names at all a remedy is told."""
    bag = without_map(tmp_path / "of_desks", labelled(place_entries("ranges"), "landmark"))
    assert names(report(bag, "--map-prior", map_file(tmp_path / "objects.json", "desk"))) == {1: "desk", 2: "desk"}
    bag = write_bag(tmp_path / "of_places", labelled(place_entries("ranges"), "landmark"))
    assert names(report(bag)) == {1: "landmark", 2: "landmark"}
    bag = write_bag(tmp_path / "of_anything", labelled(place_entries("ranges"), "object"))
    assert names(report(bag, "--map-prior", tmp_path / "objects.json")) == {1: "desk", 2: "desk"}
    bag = without_map(tmp_path / "unnamed", labelled(place_entries("ranges"), ""))
    with pytest.raises(InputError, match=r"nothing tells which labels.*set semantic_model\.kind: none"):
        report(bag)


def test_scores_of_the_shipped_classes_are_evidence_for_the_default(
    report: Callable[..., dict[int, dict[str, Any]]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    entries = labelled(place_entries("ranges"), "desk")
    for entry in of_topic(entries, topics.DETECTIONS):
        entry.message.class_names = list(FIVE)
        entry.message.class_scores = np.tile([0.9 if name == "desk" else 0.025 for name in FIVE], 2)
    bag = without_map(tmp_path / "bag", entries)
    assert names(report(bag, "--map-prior", map_file(tmp_path / "objects.json", "desk"))) == {1: "desk", 2: "desk"}
    assert "using config" not in capsys.readouterr().out


def test_where_nothing_is_detected_the_default_says_so(tmp_path: Path) -> None:
    entries = place_entries("ranges")
    for entry in of_topic(entries, topics.DETECTIONS):
        for name, value in vars(entry.message).items():
            if isinstance(value, list | np.ndarray):
                setattr(entry.message, name, value[:0])
    bag = write_bag(tmp_path / "bag", entries)
    assert configuration_for(bag) == DEFAULT_CONFIGURATION


def test_the_shipped_bag_is_run_with_the_default(capsys: pytest.CaptureFixture[str]) -> None:
    assert configuration_for(ROOT / "bags" / "aliased_room") == DEFAULT_CONFIGURATION
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("label", "mapped", "chosen"),
    [
        ("refrigerator", "", DETECTOR),
        ("refrigerator", "desk", DETECTOR),
        ("refrigerator", "refrigerator", SECOND_SESSION),
        ("desk", "refrigerator", SECOND_SESSION),
        ("desk", "desk", DEFAULT_CONFIGURATION),
        ("cabinet", "", DEFAULT_CONFIGURATION),
        ("", "", DEFAULT_CONFIGURATION),
        ("", "refrigerator", DEFAULT_CONFIGURATION),
    ],
)
def test_labels_and_map_choose_for_a_bag_with_pictures(
    label: str, mapped: str, chosen: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A map without class names is that of the bag; unlabelled detections cannot go by labels."""
    bag = write_bag(tmp_path / "bag", labelled(input_entries(2), label))
    assert configuration_for(bag, of_class(mapped) if mapped else None) == chosen
    said = capsys.readouterr().out.splitlines()
    assert len(said) == (chosen != DEFAULT_CONFIGURATION)
    assert all(f"labels ({label})" in line and f"config/{chosen.name}" in line for line in said)


@pytest.mark.parametrize(
    ("label", "mapped", "chosen"),
    [
        ("landmark", "", SECOND_SESSION),
        ("landmark", "desk", SECOND_SESSION),
        ("landmark", "landmark", SECOND_SESSION),
        ("desk", "desk", SECOND_SESSION),
        ("object", "desk", SECOND_SESSION),
        ("", "", SECOND_SESSION),
    ],
)
def test_labels_and_map_choose_for_places_alone(label: str, mapped: str, chosen: Path, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", labelled(place_entries("ranges"), label))
    assert configuration_for(bag, of_class(mapped) if mapped else None) == chosen
    if not mapped:
        (bag / "objects.json").unlink()
        assert configuration_for(bag) == DETECTOR
