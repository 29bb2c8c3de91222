"""The doctor's remedy for detections outside the planar region holds them where it is followed, wherever they are."""

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from worlds.bags.bag_factory import Entry, input_entries, of_topic, without, write_bag
from worlds.bags.places import place_entries

from semantic_slam.configuration import from_dict
from semantic_slam.doctor.bag_summary import summarise_bag
from semantic_slam.doctor.examination import examine
from semantic_slam.doctor.finding import Finding
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message, to_message

FRAMES = 12
HALF_RAD = 0.4
"""Half of the angle in which the sensor here sees."""


def turned(middle_rad: float, half_rad: float = HALF_RAD, distance_m: float = 2.0) -> list[Entry]:
    """Ranges and bearings of a sensor that looks aside, spread evenly over its field of view."""
    entries = place_entries("ranges", FRAMES)
    detections = of_topic(entries, topics.DETECTIONS)
    spread = np.linspace(-half_rad, half_rad, 2 * FRAMES).reshape(FRAMES, 2)
    for entry, offsets in zip(detections, spread, strict=True):
        bearings = np.mod(middle_rad + offsets + np.pi, 2.0 * np.pi) - np.pi
        told = replace(from_message(entry.message), bearings_rad=bearings, ranges_m=np.full(2, distance_m))
        entry.message = to_message(told)
    return entries


def of_region(folder: Path, entries: list[Entry], **region: float) -> list[Finding]:
    values: dict[str, Any] = {"association": "open", "semantic_model": {"kind": "none"}, "open_world": region}
    bag = folder if folder.exists() else write_bag(folder, entries)
    summary, faults = summarise_bag(bag, from_dict(values), MapPrior())
    return [*faults, *(found for found in examine(summary) if found.check == "region")]


def named(found: Finding) -> dict[str, float]:
    """The parameters that a remedy sets."""
    return {name: float(value) for name, value in re.findall(r"(\w+) near (-?[\d.]+)", found.remedy)}


@pytest.mark.parametrize("middle_rad", [-0.9, 1.5, 3.1])
def test_a_sensor_that_looks_aside_is_given_its_direction(tmp_path: Path, middle_rad: float) -> None:
    entries = turned(middle_rad)
    (found,) = of_region(tmp_path / "bag", entries)
    wanted = named(found)
    assert wanted.keys() == {"direction_rad", "field_of_view_rad"}
    assert math.cos(wanted["direction_rad"] - middle_rad) > math.cos(0.02)
    np.testing.assert_allclose(wanted["field_of_view_rad"], 2.0 * HALF_RAD, rtol=0.05)
    assert of_region(tmp_path / "bag", entries, **wanted) == []


def test_a_sensor_that_looks_where_it_is_said_to_is_given_its_width_alone(tmp_path: Path) -> None:
    entries = turned(-0.9, half_rad=1.0)
    (found,) = of_region(tmp_path / "bag", entries, direction_rad=-0.9)
    wanted = named(found)
    assert wanted.keys() == {"field_of_view_rad"} and "about -52 deg" in found.what
    assert of_region(tmp_path / "bag", entries, direction_rad=-0.9, **wanted) == []


def test_what_is_all_around_has_no_direction(tmp_path: Path) -> None:
    entries = turned(0.0, half_rad=np.pi)
    (found,) = of_region(tmp_path / "bag", entries)
    wanted = named(found)
    assert wanted.keys() == {"field_of_view_rad"} and wanted["field_of_view_rad"] > 6.0
    assert of_region(tmp_path / "bag", entries, **wanted) == []


@pytest.mark.parametrize(("distance_m", "name"), [(9.0, "max_range_m"), (0.1, "min_range_m")])
def test_a_distance_that_is_not_expected_is_named_alone(tmp_path: Path, distance_m: float, name: str) -> None:
    entries = turned(0.0, distance_m=distance_m)
    (found,) = of_region(tmp_path / "bag", entries)
    assert named(found).keys() == {name}
    assert of_region(tmp_path / "bag", entries, **named(found)) == []


def test_boxes_without_depth_have_no_range_to_be_set(tmp_path: Path) -> None:
    entries = input_entries(FRAMES)
    for topic in (topics.IMAGE_COMPRESSED, topics.DEPTH_COMPRESSED):
        entries = without(entries, topic)
    (found,) = of_region(tmp_path / "bag", entries, field_of_view_rad=0.1)
    assert "nan" not in found.line and named(found).keys() == {"field_of_view_rad"}
    assert of_region(tmp_path / "bag", entries, **named(found)) == []
