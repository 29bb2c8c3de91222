"""Frames and keyframes depend on the stamps of messages, never on the order in which topics arrive."""

import random
from dataclasses import replace

import numpy as np
import pytest
from worlds.bags.bag_factory import (
    HEIGHT,
    PERIOD,
    SPEED_M,
    START,
    WIDTH,
    camera_info,
    compressed,
    detections,
    frame_stamp,
    image,
    input_entries,
    odometry,
    of_topic,
    without,
)

from semantic_slam.configuration import from_dict
from semantic_slam.errors import InputError
from semantic_slam.messages import topics
from semantic_slam.messages.codec import to_message
from semantic_slam.messages.ground_truth import GroundTruthAssociations
from semantic_slam.messages.standard import time_message
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.pipeline.assembly.frame_assembler import MAX_IMAGES_WAITING, FrameAssembler
from semantic_slam.pipeline.assembly.keyframe_assembler import KeyframeAssembler

MS = 1_000_000
BOXES = np.array([[10.0, 10.0, 30.0, 30.0]])


def feed_frames(assembler, entries, flush=True):
    handlers = {
        topics.IMAGE_COMPRESSED: assembler.add_image,
        topics.DEPTH_COMPRESSED: assembler.add_depth,
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


def stamps(items):
    return [item.stamp_ns for item in items]


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
    assert drops(entries)[1] == {"detections: arrays of different lengths": 1}


def measurement(k, num_detections=1, track_ids=None, ids=None):
    d = num_detections
    return SemanticMeasurements(
        stamp_ns=frame_stamp(k), sequence=k, frame_id="base_link", class_names=("a",),
        detection_ids=np.arange(d, dtype=np.uint32) if ids is None else np.array(ids, np.uint32),
        boxes=np.zeros((d, 4)), labels=("x",) * d, scores=np.ones(d), track_ids=track_ids or ("",) * d,
        class_probability_samples=np.ones((d, 2, 1)), features=np.ones((d, 1)),
        feature_covariances=np.ones((d, 1, 1)), predictive_entropy=np.zeros(d), mutual_information=np.zeros(d),
        ranges_m=np.ones(d), bearings_rad=np.zeros(d), geometric_covariances=np.tile(np.eye(2), (d, 1, 1)),
        sensor_position=np.zeros(3), in_coverage=np.ones(d, bool),
    )  # fmt: skip


def feed_keyframes(assembler, items, flush=True):
    keyframes = []
    for item in items:
        if isinstance(item, SemanticMeasurements):
            assembler.add_measurements(item)
        elif isinstance(item, GroundTruthAssociations):
            assembler.add_identities(item)
        else:
            assembler.add_odometry(to_message(item))
        keyframes += assembler.take()
    return keyframes + (assembler.flush() if flush else [])


def drive(n=6, period=PERIOD):
    """Odometry every ``period``, from before the first frame to after the last."""
    return [
        odometry(START - PERIOD + j * period, SPEED_M * (j * period / PERIOD - 1))
        for j in range(int((n + 1) * PERIOD / period) + 1)
    ]


def test_keyframes_have_the_motion_between_them():
    keyframes = feed_keyframes(KeyframeAssembler(from_dict({})), [*drive(4), *map(measurement, range(4))])
    assert [keyframe.index for keyframe in keyframes] == [0, 1, 2, 3]
    for keyframe in keyframes:  # the first odometry lies one period before the first frame
        np.testing.assert_allclose(keyframe.odometry, [SPEED_M, 0, 0, 0, 0, 0, 1], atol=1e-12)


def test_odometry_is_interpolated_on_position_and_rotation():
    turned = replace(odometry(START + 10, 2.0), pose=np.array([2.0, 4.0, 0, 0, 0, np.sin(0.4), np.cos(0.4)]))
    assembler = KeyframeAssembler(from_dict({}))
    at = replace(measurement(0), stamp_ns=START + 5)
    (keyframe,) = feed_keyframes(assembler, [odometry(START, 0.0), at, turned])
    np.testing.assert_allclose(keyframe.odometry, [1.0, 2.0, 0, 0, 0, np.sin(0.2), np.cos(0.2)], atol=1e-12)


@pytest.mark.parametrize("seed", range(8))
def test_keyframes_do_not_depend_on_the_order_of_arrival(seed):
    odometries, measured = drive(6, period=PERIOD // 3), [measurement(k) for k in range(6)]
    expected = feed_keyframes(KeyframeAssembler(from_dict({})), [*odometries, *measured])
    chance, arrival = random.Random(seed), []
    queues = [list(odometries), list(measured)]
    while queues[0] or queues[1]:
        queue = chance.choice([queue for queue in queues if queue])
        arrival.append(queue.pop(0))
    found = feed_keyframes(KeyframeAssembler(from_dict({})), arrival)
    assert stamps(found) == stamps(expected) == [frame_stamp(k) for k in range(6)]
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a.odometry, b.odometry)
        np.testing.assert_array_equal(a.odometry_covariance, b.odometry_covariance)


def test_a_keyframe_waits_for_odometry_past_it():
    assembler = KeyframeAssembler(from_dict({}))
    before, after = [odometry(START - 2, 0.0), odometry(START - 1, 0.0)], odometry(START + 1, 1.0)
    assert feed_keyframes(assembler, [*before, measurement(0)], flush=False) == []
    assert len(feed_keyframes(assembler, [after], flush=False)) == 1


@pytest.mark.parametrize(
    ("wrong_odometries", "wrong_measurements", "expected"),
    [(2, 1, range(1, 8)), (2, 2, range(2, 8)), (3, 1, [2000]), (3, 2, [2000, 2001])],
)
def test_keyframes_never_go_back_in_time_whatever_the_first_stamps_are(wrong_odometries, wrong_measurements, expected):
    """Two wrong stamps of each topic cost their messages; after a keyframe, an earlier time is another session."""
    odometries, measured = drive(8), list(map(measurement, range(8)))
    for items, wrong in ((odometries, wrong_odometries), (measured, wrong_measurements)):
        items[:wrong] = [replace(item, stamp_ns=item.stamp_ns + 2000 * PERIOD) for item in items[:wrong]]
    arrival = [odometries[0], *(item for pair in zip(odometries[1:9], measured, strict=True) for item in pair)]
    assembler = KeyframeAssembler(from_dict({}))
    assert stamps(feed_keyframes(assembler, arrival, flush=False)) == [frame_stamp(k) for k in expected]
    assert assembler.is_over == (wrong_odometries > 2)


def test_flush_uses_the_last_odometry_only_while_it_is_fresh():
    assembler = KeyframeAssembler(from_dict({}))
    items = [odometry(START, 0.0), measurement(0), measurement(1), measurement(3)]  # 0, 0.5 and 1.5 s after it
    assert stamps(feed_keyframes(assembler, items)) == [frame_stamp(0), frame_stamp(1)]
    assert assembler.dropped == {"/classifier/measurements: no odom at their stamp": 1}


def test_the_first_odometry_is_used_before_its_stamp_only_shortly():
    assembler = KeyframeAssembler(from_dict({}))
    begin = frame_stamp(3)
    items = [*(measurement(k) for k in range(5)), odometry(begin, 0.0), odometry(begin + 2 * PERIOD, 1.0)]
    assert stamps(feed_keyframes(assembler, items)) == [frame_stamp(k) for k in (1, 2, 3, 4)]  # from 1 s before it
    assert assembler.dropped == {"/classifier/measurements: no odom at their stamp": 1}


def test_a_first_odometry_with_a_wrong_stamp_costs_no_measurements():
    assembler = KeyframeAssembler(from_dict({}))
    later = [odometry(START + n * PERIOD // 2, 0.1 * n) for n in range(1, 6)]
    items = [odometry(START + 1000 * PERIOD, 0.0), measurement(0), measurement(1), *later]
    assert stamps(feed_keyframes(assembler, items)) == [frame_stamp(0), frame_stamp(1)]
    assert assembler.dropped == {"odom: stamp leaps ahead of those around it": 1}


def test_covariance_grows_with_path_and_turn():
    noise = {
        "sigma_translation_per_m": 0.1,
        "sigma_rotation_per_m": 0.2,
        "sigma_rotation_per_rad": 0.3,
        "sigma_translation_floor_m": 0.01,
        "sigma_rotation_floor_rad": 0.02,
    }
    assembler = KeyframeAssembler(from_dict({"odometry": noise}))
    there_and_back = [odometry(START - 2, 0.0), odometry(START - 1, 1.0)]
    end = replace(odometry(START, 0.0), pose=np.array([0.0, 0, 0, 0, 0, np.sin(0.25), np.cos(0.25)]))  # turned by 0.5
    (keyframe,) = feed_keyframes(assembler, [*there_and_back, end, measurement(0)])
    translation = 0.01**2 + (0.1 * 2.0) ** 2  # 1 m out and 1 m back
    rotation = 0.02**2 + (0.2 * 2.0) ** 2 + (0.3 * 0.5) ** 2
    expected = np.diag([translation, translation, 0, 0, 0, rotation])
    np.testing.assert_allclose(keyframe.odometry_covariance, expected, atol=1e-12)


def test_an_empty_frame_is_no_keyframe_and_its_motion_is_kept():
    measured = [measurement(0), measurement(1, num_detections=0), measurement(2)]
    assembler = KeyframeAssembler(from_dict({}))
    keyframes = feed_keyframes(assembler, [*drive(3), *measured])
    assert stamps(keyframes) == [frame_stamp(0), frame_stamp(2)]
    assert keyframes[1].index == 1
    np.testing.assert_allclose(keyframes[1].odometry[0], 2 * SPEED_M)
    assert not assembler.dropped


def test_in_an_open_world_an_empty_frame_counts_and_what_lies_outside_the_region_does_not():
    seen = replace(measurement(1, num_detections=3), ranges_m=np.array([4.0, 6.5, np.nan]))
    seen = replace(seen, bearings_rad=np.array([0.1, 0.0, 0.9]), labels=("near", "far", "aside"))
    assembler = KeyframeAssembler(from_dict({"association": "open"}))
    keyframes = feed_keyframes(assembler, [*drive(3), measurement(0, num_detections=0), seen])
    assert [keyframe.measurements.labels for keyframe in keyframes] == [(), ("near",)]
    assert keyframes[1].measurements.detection_ids.tolist() == [0]
    assert sum(assembler.dropped.values()) == 2
    assert all(reason.endswith("detections outside the region of open_world") for reason in assembler.dropped)


def test_the_odometry_policy_keeps_a_distance():
    configuration = from_dict({"keyframes": {"policy": "odometry", "distance_m": 0.25}})
    measured = [measurement(k, num_detections=k % 2) for k in range(10)]
    keyframes = feed_keyframes(KeyframeAssembler(configuration), [*drive(10), *measured])
    assert stamps(keyframes) == [frame_stamp(k) for k in (0, 3, 6, 9)]  # 0.1 m per frame, empty frames too


def test_odometry_that_is_not_finite_is_bridged():
    odometries = drive(3)
    odometries[2] = replace(odometries[2], pose=odometries[2].pose * np.nan)
    assembler = KeyframeAssembler(from_dict({}))
    keyframes = feed_keyframes(assembler, [*odometries, *map(measurement, range(3))])
    np.testing.assert_allclose([keyframe.odometry[0] for keyframe in keyframes], SPEED_M)
    assert assembler.dropped == {"odom: pose is not finite": 1}


def test_odometry_going_backwards_in_time_is_dropped():
    odometries = drive(3)
    assembler = KeyframeAssembler(from_dict({}))
    spoiled = [*odometries[:3], replace(odometries[0], pose=odometries[0].pose + 50.0), *odometries[3:]]
    keyframes = feed_keyframes(assembler, [*spoiled, *map(measurement, range(3))])
    np.testing.assert_allclose([keyframe.odometry[0] for keyframe in keyframes], SPEED_M)
    assert assembler.dropped == {"odom: time goes backwards": 1}
    bound = 2 * from_dict({}).odometry.sigma_translation_floor_m ** 2
    assert all(keyframe.odometry_covariance[0, 0] < bound for keyframe in keyframes)


GIVEN = {"association": "given"}


def test_given_identities_come_by_stamp_and_index():
    assembler = KeyframeAssembler(from_dict(GIVEN), has_identities=True)
    truth = [GroundTruthAssociations(frame_stamp(k), (f"{k}a", f"{k}b", "")) for k in range(3)]
    measured = [measurement(0, 2, ids=[0, 2]), measurement(1, 1, ids=[1]), measurement(2, 1)]
    keyframes = feed_keyframes(assembler, [*drive(3), *measured, *truth])
    assert [keyframe.measurements.track_ids for keyframe in keyframes] == [("0a", ""), ("1b",), ("2a",)]


def test_given_track_ids_of_the_detections_are_kept():
    assembler = KeyframeAssembler(from_dict(GIVEN))
    (keyframe,) = feed_keyframes(assembler, [*drive(1), measurement(0, track_ids=("17",))])
    assert keyframe.measurements.track_ids == ("17",)


def test_given_without_any_identities_is_bad_input():
    with pytest.raises(InputError, match=r"track_ids.*set association: enumerated"):
        feed_keyframes(KeyframeAssembler(from_dict(GIVEN)), [*drive(1), measurement(0)])


def test_given_identities_of_another_stamp_are_not_used():
    assembler = KeyframeAssembler(from_dict(GIVEN), has_identities=True)
    truth = [GroundTruthAssociations(frame_stamp(1), ("7",))]
    keyframes = feed_keyframes(assembler, [*drive(2), measurement(0), measurement(1), *truth])
    assert [keyframe.measurements.track_ids for keyframe in keyframes] == [("7",)]
    assert keyframes[0].index == 0
    assert assembler.dropped == {"/classifier/measurements: no /ground_truth/associations of their stamp": 1}


def test_a_depth_image_of_another_kind_is_named():
    entries = input_entries(1)
    of_topic(entries, topics.DEPTH_COMPRESSED)[0].message = compressed(START, "jpeg", np.frombuffer(b"x", np.uint8))
    frames, dropped = drops(entries)
    assert frames[0].depth_m is None
    assert list(dropped) == ["depth: a depth image of format 'jpeg' does not decode; send a 16UC1 png in millimetres"]
