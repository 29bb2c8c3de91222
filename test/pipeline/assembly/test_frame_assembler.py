"""Frames depend on the stamps of messages, never on the order in which topics arrive."""

import random
import re
from dataclasses import replace

import numpy as np
import pytest
from worlds.bags.bag_factory import (
    HEIGHT,
    START,
    WIDTH,
    camera_info,
    compressed,
    detections,
    frame_stamp,
    image,
    input_entries,
    of_topic,
    stamps,
    without,
)
from worlds.bags.stereo import by_stereo

from semantic_slam.configuration import from_dict
from semantic_slam.errors import InputError
from semantic_slam.messages import topics
from semantic_slam.messages.codec import to_message
from semantic_slam.messages.standard import time_message
from semantic_slam.pipeline.assembly.frame_assembler import MAX_IMAGES_WAITING, FrameAssembler

MS = 1_000_000
BOXES = np.array([[10.0, 10.0, 30.0, 30.0]])


def feed_frames(assembler, entries, flush=True):
    handlers = {
        topics.IMAGE_COMPRESSED: assembler.add_image,
        topics.DEPTH_COMPRESSED: assembler.add_depth,
        topics.DISPARITY: assembler.add_depth,
        topics.CAMERA_INFO: assembler.add_camera_info,
        topics.DETECTIONS: assembler.add_detections,
    }
    frames = []
    for entry in entries:
        if entry.topic in handlers:
            handlers[entry.topic](entry.message)
            frames += assembler.take()
    return frames + (assembler.flush() if flush else [])


def shuffled(entries, seed):
    """Another order of arrival: topics overtake each other, messages of one topic do not."""
    chance = random.Random(seed)
    queues = {}
    for entry in entries:
        queues.setdefault(entry.topic, []).append(entry)
    order = [entry.topic for entry in entries]
    chance.shuffle(order)
    return [queues[topic].pop(0) for topic in order]


def shift(entries, topic, offset_ns):
    for entry in of_topic(entries, topic):
        stamp = entry.message.header.stamp
        entry.message.header.stamp = time_message(stamp.sec * 10**9 + stamp.nanosec + offset_ns)
    return entries


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("offset_ns", [0, 15 * MS, -15 * MS])
def test_frames_do_not_depend_on_the_order_of_arrival(seed, offset_ns):
    entries = shift(input_entries(5), topics.IMAGE_COMPRESSED, offset_ns)
    expected = feed_frames(FrameAssembler(from_dict({}), has_depth=True), entries)
    found = feed_frames(FrameAssembler(from_dict({}), has_depth=True), shuffled(entries, seed))
    assert stamps(found) == stamps(expected) == [frame_stamp(k) for k in range(5)]
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a.image, b.image)
        np.testing.assert_array_equal(a.depth_m, b.depth_m)


def test_a_frame_has_colours_and_metres():
    frame = feed_frames(FrameAssembler(from_dict({}), has_depth=True), input_entries(1))[0]
    box = frame.detections.boxes[0]
    column, row = int(box[[0, 2]].mean()), int(box[[1, 3]].mean())
    np.testing.assert_allclose(frame.image[row, column], (200, 60, 40), atol=6)  # written as BGR 40, 60, 200
    assert frame.depth_m[row, column] == pytest.approx(2.9)  # object at x = 3.0, camera at 0.1
    assert np.isnan(frame.depth_m[0, 0])


def test_a_frame_leaves_as_soon_as_it_is_complete():
    entries = input_entries(2)
    assembler = FrameAssembler(from_dict({}), has_depth=True)
    assert stamps(feed_frames(assembler, entries, flush=False)) == [frame_stamp(0), frame_stamp(1)]


def test_the_nearest_image_wins_even_when_it_comes_later():
    assembler = FrameAssembler(from_dict({"perception": {"sync_tolerance_s": 0.1}}), has_depth=False)
    assembler.add_camera_info(camera_info(START))
    assembler.add_detections(to_message(detections(START, BOXES)))
    assembler.add_image(image(START - 50 * MS, BOXES))
    assert assembler.take() == []
    assembler.add_image(image(START + 20 * MS, BOXES * [1, 1, 4, 4]))
    (frame,) = assembler.take()
    np.testing.assert_allclose(frame.image[100, 100], (200, 60, 40), atol=6)  # inside the larger box only


def test_images_without_detections_are_not_dropped_inputs():
    assembler = FrameAssembler(from_dict({}), has_depth=False)
    entries = [entry for k, entry in enumerate(input_entries(6)) if entry.topic != topics.DETECTIONS or k % 2]
    feed_frames(assembler, entries)
    assert not assembler.dropped


def test_images_do_not_pile_up():
    assembler = FrameAssembler(from_dict({}), has_depth=False)
    one = image(START, BOXES)
    for k in range(MAX_IMAGES_WAITING + 5):
        assembler.add_image(replace(one, header=replace(one.header, stamp=time_message(START + k))))
    assert assembler.dropped == {"image: nothing matched it for too long": 5}


def drops(entries, has_depth=True, **perception):
    assembler = FrameAssembler(from_dict({"perception": perception}), has_depth)
    return feed_frames(assembler, entries), dict(assembler.dropped)


def test_a_missing_image_is_counted_and_the_others_are_used():
    entries = input_entries(4)
    entries.remove(of_topic(entries, topics.IMAGE_COMPRESSED)[1])
    frames, dropped = drops(entries)
    assert stamps(frames) == [frame_stamp(k) for k in (0, 2, 3)]
    assert dropped == {"detections: no image of their stamp": 1}


def test_missing_depth_makes_a_frame_bearing_only():
    entries = input_entries(3)
    entries.remove(of_topic(entries, topics.DEPTH_COMPRESSED)[1])
    frames, dropped = drops(entries)
    assert [frame.depth_m is None for frame in frames] == [False, True, False]
    assert dropped == {"depth: none of the detections' stamp, bearing only": 1}


def test_a_run_without_depth_waits_for_none():
    frames, dropped = drops(without(input_entries(3), topics.DEPTH_COMPRESSED), has_depth=False)
    assert len(frames) == 3 and not dropped


def test_without_camera_info_nothing_is_guessed():
    frames, dropped = drops(without(input_entries(3), topics.CAMERA_INFO))
    assert frames == [] and dropped == {"detections: no camera_info came": 3}


def test_an_uncalibrated_camera_is_bad_input():
    info = camera_info(START)
    info.k[0] = 0.0
    with pytest.raises(InputError, match="not calibrated"):
        FrameAssembler(from_dict({}), has_depth=False).add_camera_info(info)


def test_a_wrong_frame_id_is_named():
    entries = input_entries(2)
    of_topic(entries, topics.DETECTIONS)[0].message.header.frame_id = "lidar"
    frames, dropped = drops(entries)
    assert stamps(frames) == [frame_stamp(1)]
    assert dropped == {"detections: frame id 'lidar' is not the camera's 'camera_optical_frame'": 1}


@pytest.mark.parametrize("data", [b"", b"no jpeg at all", "cut"])
def test_an_image_that_does_not_decode_is_counted(data):
    entries = input_entries(2)
    message = of_topic(entries, topics.IMAGE_COMPRESSED)[0].message
    message.data = message.data[:20] if data == "cut" else np.frombuffer(data, np.uint8)
    frames, dropped = drops(entries)
    assert stamps(frames) == [frame_stamp(1)]
    assert dropped == {"image: an image of format 'jpeg' does not decode; send jpeg or png": 1}


def test_an_image_of_another_size_than_the_camera():
    entries = input_entries(1)
    of_topic(entries, topics.CAMERA_INFO)[0].message.width = 320
    assert drops(entries)[1] == {f"image: size {WIDTH} x {HEIGHT} is not the 320 x {HEIGHT} of camera_info": 1}


@pytest.mark.parametrize(("topic", "name"), [(topics.IMAGE_COMPRESSED, "image"), (topics.DETECTIONS, "detections")])
def test_time_going_backwards_is_counted_by_topic(topic, name):
    entries = input_entries(4)
    old, late = of_topic(entries, topic)[0], of_topic(entries, topic)[2]
    entries.insert(entries.index(late) + 1, old)
    frames, dropped = drops(entries)
    assert stamps(frames) == [frame_stamp(k) for k in range(4)]
    assert dropped == {f"{name}: time goes backwards": 1}


def test_boxes_and_labels_of_different_lengths():
    entries = input_entries(2)
    of_topic(entries, topics.DETECTIONS)[0].message.labels = ["one"]
    (told,) = drops(entries)[1].items()
    assert told[1] == 1
    assert told[0].startswith("detections: arrays of different lengths (boxes: ") and "shape (D=1 x 4))" in told[0]


def test_a_depth_image_of_another_kind_is_named():
    entries = input_entries(1)
    of_topic(entries, topics.DEPTH_COMPRESSED)[0].message = compressed(START, "jpeg", np.frombuffer(b"x", np.uint8))
    frames, dropped = drops(entries)
    assert frames[0].depth_m is None
    assert list(dropped) == ["depth: a depth image of format 'jpeg' does not decode; send a 16UC1 png in millimetres"]


def test_faults_of_disparities_are_counted_under_their_topic_with_the_remedy_of_a_stereo_pair():
    entries = by_stereo(input_entries(4))
    handlers = of_topic(entries, topics.DISPARITY)
    handlers[0].message.t *= 1000.0  # millimetres
    handlers[1].message.t = 0.0
    entries.remove(handlers[2])
    entries.append(handlers[0])
    frames, dropped = drops(entries)
    assert [frame.depth_m is None for frame in frames] == [True, True, True, False]
    assert set(dropped.values()) == {1}
    kinds = (
        "half of it lies.*correct its focal length f in pixels and its baseline T in metres",
        "focal length.*above 0",
    )
    kinds += ("none of the detections' stamp, bearing only", "time goes backwards")
    assert len(dropped) == len(kinds)
    assert all(any(re.match(f"disparity: {kind}", reason) for reason in dropped) for kind in kinds)
