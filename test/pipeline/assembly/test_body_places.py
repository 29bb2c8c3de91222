"""Positions without boxes are of the header's frame: moved to the body by static transforms, or dropped and counted."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from worlds.bags.bag_factory import (
    OPTICAL,
    T_BASE_CAMERA,
    Entry,
    of_topic,
    static_transform,
    write_bag,
    write_configuration,
)
from worlds.bags.imported import read_bag
from worlds.bags.places import NUM_FRAMES, place_entries, told_by_sensor

from semantic_slam.configuration import from_dict, load_configuration
from semantic_slam.errors import InputError
from semantic_slam.geometry import so3
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message, to_message
from semantic_slam.messages.sensor import TransformTree
from semantic_slam.perception.frame import Detections
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.pipeline.assembly.places_assembler import PlacesAssembler
from semantic_slam.pipeline.offline import RunSummary, run_bag

STATED = np.diag([0.01, 0.04, 0.09])
SPATIAL = {"state_space": "spatial", "association": "open"}


def first_of(entries: list[Entry]) -> Detections:
    found: Detections = from_message(of_topic(entries, topics.DETECTIONS)[0].message)
    return found


def mounted() -> TransformTree:
    tree = TransformTree()
    tree.add(static_transform(1, OPTICAL, T_BASE_CAMERA))
    return tree


def assembled(
    *found: Detections, tree: TransformTree | None = None, base_frame: str = "base_link"
) -> tuple[list[SemanticMeasurements], dict[str, int]]:
    """What becomes of messages, and what of them is dropped."""
    places = PlacesAssembler(from_dict({"perception": {"base_frame": base_frame}}), lambda _: T_BASE_CAMERA, tree)
    for each in found:
        places.add_detections(to_message(each))
    return places.flush(), dict(places.dropped)


def run(folder: Path, entries: list[Entry]) -> tuple[dict[str, list[object]], RunSummary]:
    configuration = load_configuration(write_configuration(folder / "configuration"))
    summary = run_bag(write_bag(folder / "bag", entries), folder / "belief", configuration)
    return read_bag(folder / "belief"), summary


def test_the_map_is_the_same_whichever_frame_states_the_positions(tmp_path: Path) -> None:
    body, _ = run(tmp_path / "body", place_entries("positions"))
    sensor, summary = run(tmp_path / "sensor", told_by_sensor(place_entries("positions")))
    assert not summary.dropped and summary.num_keyframes == NUM_FRAMES
    ours, theirs = (bag["/hypothesis_manager/belief"][-1] for bag in (sensor, body))
    np.testing.assert_allclose(ours.object_poses, theirs.object_poses, atol=1e-9)
    np.testing.assert_allclose(ours.poses, theirs.poses, atol=1e-9)


@pytest.mark.parametrize("settings", [{}, SPATIAL])
def test_stated_covariances_turn_with_the_positions(settings: dict[str, str]) -> None:
    told = first_of(place_entries("positions"))
    turn = so3.matrix(T_BASE_CAMERA[3:] / np.linalg.norm(T_BASE_CAMERA[3:]))
    in_body = replace(told, position_covariances=np.tile(STATED, (2, 1, 1)))
    in_sensor = first_of(told_by_sensor(place_entries("positions")))
    in_sensor = replace(in_sensor, position_covariances=np.tile(turn.T @ STATED @ turn, (2, 1, 1)))
    measured = []
    for found in (in_body, in_sensor):
        places = PlacesAssembler(from_dict(settings), lambda _: T_BASE_CAMERA, mounted())
        places.add_detections(to_message(found))
        measured += places.take()
        assert not places.dropped
    ours, theirs = measured
    for name, values in vars(theirs).items():
        if isinstance(values, np.ndarray):
            np.testing.assert_allclose(getattr(ours, name), values, atol=1e-12, err_msg=name)


def test_positions_in_a_frame_that_nothing_connects_with_the_body_are_dropped_with_the_remedy() -> None:
    told = first_of(told_by_sensor(place_entries("positions")))
    measured, dropped = assembled(told)
    ((reason, count),) = dropped.items()
    assert (measured, count) == ([], 1)
    assert reason.startswith("detections: places of frame 'camera_optical_frame', to which no static transforms lead")
    assert "publish /tf_static" in reason and "perception.base_frame" in reason and "--base-frame" in reason


def test_positions_of_another_body_are_not_those_of_perception_base_frame() -> None:
    told = first_of(place_entries("positions"))
    measured, dropped = assembled(told, base_frame="base_footprint")
    assert not measured and list(dropped.values()) == [1]
    ahead = TransformTree()
    transform = static_transform(1, "base_link", np.array([0.6, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0]))
    transform.transforms[0].header.frame_id = "base_footprint"
    ahead.add(transform)
    (found,), dropped = assembled(told, tree=ahead, base_frame="base_footprint")
    x, y = told.positions[:, 0] + 0.6, told.positions[:, 1]
    np.testing.assert_allclose(found.ranges_m, np.hypot(x, y))
    assert not dropped and found.frame_id == "base_footprint"


@pytest.mark.parametrize("told", ["ranges", "positions"])
def test_ranges_and_bearings_and_what_has_no_height_are_never_moved_from_another_frame(told: str) -> None:
    found = replace(first_of(place_entries(told)), frame_id=OPTICAL)
    flat = found.positions.copy()
    flat[0, 2] = np.nan
    measured, dropped = assembled(replace(found, positions=flat), tree=mounted())
    ((reason, count),) = dropped.items()
    assert (measured, count) == ([], 1)
    assert "by range and bearing or without z" in reason and "state these from the body, or positions" in reason


@pytest.mark.parametrize("frame_id", ["", "base_link", "/base_link"])
@pytest.mark.parametrize("told", ["ranges", "positions"])
def test_without_a_frame_or_in_the_body_places_stay(told: str, frame_id: str) -> None:
    found = first_of(place_entries(told))
    (ours,), dropped = assembled(replace(found, frame_id=frame_id), tree=mounted())
    (theirs,), _ = assembled(found)
    np.testing.assert_array_equal(ours.ranges_m, theirs.ranges_m)
    assert not dropped


def test_nothing_seen_is_of_no_frame_and_what_is_dropped_is_no_miss() -> None:
    """Frames between which one is dropped go on counting up, without a frame that showed nothing in its place."""
    told = first_of(place_entries("positions"))
    nothing = replace(told.take(np.zeros(0, dtype=np.intp)), frame_id="lidar")
    of_lidar = replace(told, frame_id="lidar", stamp_ns=told.stamp_ns + 1)
    last = replace(told, stamp_ns=told.stamp_ns + 2)
    measured, dropped = assembled(nothing, of_lidar, last)
    assert [(len(each), each.sequence, each.stamp_ns) for each in measured] == [
        (0, 0, nothing.stamp_ns),
        (2, 1, last.stamp_ns),
    ]
    assert list(dropped.values()) == [1]


def test_a_run_without_usable_places_ends_with_the_remedy(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"could be made: detections: places of frame .* publish /tf_static") as fault:
        run(tmp_path, told_by_sensor(place_entries("positions"), is_mounted=False))
    assert "\n" not in str(fault.value)
