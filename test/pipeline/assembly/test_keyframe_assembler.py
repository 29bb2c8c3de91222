"""Keyframes depend on the stamps of messages, never on the order in which topics arrive."""

import random
from dataclasses import replace

import numpy as np
import pytest
from worlds.bags.bag_factory import PERIOD, SPEED_M, START, frame_stamp, odometry, stamps

from semantic_slam.configuration import from_dict
from semantic_slam.errors import InputError
from semantic_slam.messages.codec import to_message
from semantic_slam.messages.ground_truth import GroundTruthAssociations
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.pipeline.assembly.keyframe_assembler import KeyframeAssembler


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
