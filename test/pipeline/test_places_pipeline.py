"""Bags of odometry and detections without any picture: offline, through the same parts as the nodes."""

from dataclasses import replace

import numpy as np
import pytest
from worlds.bags.bag_factory import (
    OBJECTS,
    T_BASE_CAMERA,
    frame_stamp,
    input_entries,
    of_topic,
    without,
    write_bag,
    write_configuration,
)
from worlds.bags.imported import read_bag
from worlds.bags.places import NUM_FRAMES, place_entries, relative_positions

from semantic_slam.configuration import from_dict, load_configuration
from semantic_slam.errors import InputError
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message, to_message
from semantic_slam.messages.sensor import TransformTree
from semantic_slam.perception.places import NO_PLACE
from semantic_slam.pipeline.assembly.places_assembler import PlacesAssembler
from semantic_slam.pipeline.offline import run_bag

NOWHERE = from_dict({})


def run(folder, entries, **changes):
    """What the pipeline makes of a bag: its topics, and the run's summary."""
    configuration = load_configuration(write_configuration(folder / "configuration", **changes))
    summary = run_bag(write_bag(folder / "bag", entries), folder / "belief", configuration)
    return read_bag(folder / "belief"), summary


@pytest.mark.parametrize("told", ["ranges", "positions"])
def test_places_become_a_belief_without_a_network(tmp_path, told):
    """No file of the network is there, so that nothing could be loaded."""
    bag, summary = run(tmp_path, place_entries(told), perception={"network": "nowhere.safetensors"})
    assert summary.num_keyframes == summary.num_frames == NUM_FRAMES
    assert not summary.dropped
    first, last = bag["/classifier/measurements"][0], bag["/hypothesis_manager/belief"][-1]
    expected = relative_positions(0)
    np.testing.assert_allclose(first.ranges_m, np.hypot(expected[:, 0], expected[:, 1]))
    np.testing.assert_allclose(first.bearings_rad, np.arctan2(expected[:, 1], expected[:, 0]))
    assert [item.sequence for item in bag["/classifier/measurements"]] == list(range(NUM_FRAMES))
    seen = last.object_poses[:, :2] - last.poses[0, :2]
    np.testing.assert_allclose(seen, relative_positions(NUM_FRAMES - 1)[:, :2], atol=0.01)


def test_positions_and_ranges_tell_the_same(tmp_path):
    ranges, _ = run(tmp_path / "a", place_entries("ranges"))
    positions, _ = run(tmp_path / "b", place_entries("positions"))
    for ours, theirs in zip(ranges["/hypothesis_manager/belief"], positions["/hypothesis_manager/belief"], strict=True):
        np.testing.assert_allclose(ours.poses, theirs.poses, atol=1e-7)


def test_an_open_world_needs_no_picture_either(tmp_path):
    bag, _ = run(tmp_path, place_entries("ranges"), association="open")
    last = bag["/hypothesis_manager/belief"][-1]
    likely = last.existence > 0.9
    np.testing.assert_allclose(np.sort(last.object_poses[likely, 0]), np.sort(OBJECTS[:, 0]), atol=0.3)


def test_detections_outside_a_turned_region_are_counted(tmp_path):
    turned = {"field_of_view_rad": 0.3, "direction_rad": float(np.arctan2(0.5, 3.0))}
    _, summary = run(tmp_path, place_entries("ranges"), association="open", open_world=turned)
    (reason,) = summary.dropped
    assert reason == "/classifier/measurements: detections outside the region of open_world"
    assert summary.dropped[reason] == NUM_FRAMES  # the object on the right alone


def test_given_numbers_are_used_without_a_picture(tmp_path):
    bag, _ = run(tmp_path, place_entries("ranges", track_ids=("1", "2")), association="given")
    assert bag["/classifier/measurements"][0].track_ids == ("1", "2")


def test_a_place_that_is_nan_is_dropped_and_counted(tmp_path):
    entries = place_entries("ranges")
    found = from_message(of_topic(entries, topics.DETECTIONS)[1].message)
    bad = replace(found, bearings_rad=np.array([np.nan, found.bearings_rad[1]]))
    of_topic(entries, topics.DETECTIONS)[1].message = to_message(bad)
    bag, summary = run(tmp_path, entries)
    assert summary.dropped == {NO_PLACE: 1}
    assert bag["/classifier/measurements"][1].detection_ids.tolist() == [1]


def test_boxes_of_a_known_camera_are_bearings(tmp_path):
    entries = input_entries(NUM_FRAMES)
    for topic in (topics.IMAGE_COMPRESSED, topics.DEPTH_COMPRESSED):
        entries = without(entries, topic)
    bag, summary = run(tmp_path, entries)
    assert summary.num_keyframes == NUM_FRAMES
    measured = bag["/classifier/measurements"][0]
    forward, left = (OBJECTS - T_BASE_CAMERA[:3])[:, :2].T
    assert np.isnan(measured.ranges_m).all()
    np.testing.assert_allclose(measured.bearings_rad, np.arctan2(left, forward), atol=1e-9)
    np.testing.assert_allclose(measured.sensor_position, T_BASE_CAMERA[:3])


def test_depth_without_pictures_is_said_not_to_be_used(tmp_path, capsys):
    bag, _ = run(tmp_path, without(input_entries(NUM_FRAMES), topics.IMAGE_COMPRESSED))
    assert "; /depth/compressed is not used without" in capsys.readouterr().out
    assert np.isnan(bag["/classifier/measurements"][0].ranges_m).all()


def test_boxes_without_a_camera_are_counted(tmp_path):
    entries = input_entries(NUM_FRAMES)
    for topic in (topics.IMAGE_COMPRESSED, topics.DEPTH_COMPRESSED, topics.CAMERA_INFO):
        entries = without(entries, topic)
    with pytest.raises(InputError, match=r"not one keyframe could be made: detection without a place.* \(8\)"):
        run(tmp_path, entries)


def boxes_and_camera():
    entries = input_entries(3)
    return of_topic(entries, topics.DETECTIONS), of_topic(entries, topics.CAMERA_INFO)


def test_boxes_wait_for_the_camera_and_places_for_nothing():
    boxes, cameras = boxes_and_camera()
    assembler = PlacesAssembler(NOWHERE, lambda _: T_BASE_CAMERA)
    assembler.add_detections(boxes[0].message)
    assert (assembler.take(), assembler.num_waiting) == ([], 1)
    assembler.add_camera_info(cameras[0].message)
    (measured,) = assembler.take()
    assert (measured.stamp_ns, len(measured), assembler.num_waiting) == (frame_stamp(0), 2, 0)
    places = PlacesAssembler(NOWHERE, lambda _: T_BASE_CAMERA)
    places.add_detections(of_topic(place_entries("ranges"), topics.DETECTIONS)[0].message)
    assert len(places.take()) == 1


def test_boxes_whose_camera_nobody_has_placed_are_counted():
    boxes, cameras = boxes_and_camera()
    tree = TransformTree()
    assembler = PlacesAssembler(NOWHERE, lambda frame: tree.lookup("base_link", frame))
    assembler.add_camera_info(cameras[0].message)
    assembler.add_detections(boxes[0].message)
    (measured,) = assembler.take()
    assert len(measured) == 0
    (reason,) = (text for text in assembler.dropped if text != NO_PLACE)
    assert "no static transforms lead from base_link to camera_optical_frame" in reason


def test_boxes_of_another_camera_are_counted():
    boxes, cameras = boxes_and_camera()
    assembler = PlacesAssembler(NOWHERE, lambda _: T_BASE_CAMERA)
    assembler.add_camera_info(cameras[0].message)
    boxes[0].message.header.frame_id = "another"
    assembler.add_detections(boxes[0].message)
    assert [len(measured) for measured in assembler.take()] == [0]
    assert any("frame id 'another' is not the camera's" in reason for reason in assembler.dropped)


def test_detections_of_different_lengths_are_counted():
    assembler = PlacesAssembler(NOWHERE, lambda _: T_BASE_CAMERA)
    message = of_topic(place_entries("ranges"), topics.DETECTIONS)[0].message
    message.ranges_m = message.ranges_m[:1]
    assembler.add_detections(message)
    told = "detections: arrays of different lengths (ranges_m: 1 values, expected shape (D=2))"
    assert (assembler.take(), assembler.dropped) == ([], {told: 1})
    message.ranges_m = message.ranges_m[:0]
    message.class_names = ["chair", "cup"]
    message.class_scores = np.ones(2)
    assembler.add_detections(message)
    message.class_scores = np.ones(3)  # told as the first one of this field
    assembler.add_detections(message)
    scores = "detections: arrays of different lengths (class_scores: 2 values, expected shape (D=2 x C=2))"
    assert assembler.dropped == {told: 1, scores: 2}
