"""Names that others send, however many and long, are counted within bounds, and nothing is left uncounted."""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from worlds.bags.bag_factory import T_BASE_CAMERA, camera_info, detections, frame_stamp, odometry

from semantic_slam.configuration import Configuration
from semantic_slam.inference.inputs.keyframe import OdometrySample
from semantic_slam.messages import topics
from semantic_slam.messages.codec import to_message
from semantic_slam.messages.inertial import imu_message
from semantic_slam.messages.sensor import TransformTree
from semantic_slam.perception.places import NO_PLACE
from semantic_slam.pipeline.assembly.frame_assembler import FrameAssembler
from semantic_slam.pipeline.assembly.keyframe_assembler import KeyframeAssembler
from semantic_slam.pipeline.assembly.places_assembler import PlacesAssembler
from semantic_slam.pipeline.gravity.gravity_by_imu import GravityByImu, ImuSource
from semantic_slam.pipeline.odometry.motion import start
from semantic_slam.pipeline.odometry.odometry_path import OdometryPath
from semantic_slam.reasons import LONGEST_NAME, MOST_REASONS, OTHER

NAMES = [f"{number:03}{'x' * 1000}" for number in range(250)]
BOX = np.array([[10.0, 10.0, 60.0, 60.0]])
PLAIN = Configuration.of(semantic_model={"kind": "none"})


def frame_ids_of_detections(assembler: FrameAssembler | PlacesAssembler) -> Counter[str]:
    assembler.add_camera_info(camera_info(frame_stamp(0)))
    for k, name in enumerate(NAMES):
        assembler.add_detections(to_message(replace(detections(frame_stamp(k), BOX), frame_id=name)))
    assembler.flush()
    return assembler.dropped


def beside_images() -> Counter[str]:
    return frame_ids_of_detections(FrameAssembler(PLAIN, has_depth=False))


def without_images() -> Counter[str]:
    dropped = frame_ids_of_detections(PlacesAssembler(PLAIN, lambda _: T_BASE_CAMERA))
    assert dropped.pop(NO_PLACE) == len(NAMES)
    return dropped


def of_odometry() -> Counter[str]:
    assembler = KeyframeAssembler(PLAIN)
    for k, name in enumerate(NAMES):
        assembler.add_odometry(to_message(replace(odometry(frame_stamp(k), 0.0), child_frame_id=name)))
    return assembler.dropped


def of_labels() -> Counter[str]:
    wanted = replace(PLAIN, perception=replace(PLAIN.perception, labels=("chair",)))
    assembler = PlacesAssembler(wanted, lambda _: T_BASE_CAMERA)
    assembler.add_camera_info(camera_info(frame_stamp(0)))
    for k, name in enumerate(NAMES):
        assembler.add_detections(to_message(replace(detections(frame_stamp(k), BOX), labels=(name,))))
    assembler.flush()
    return assembler.dropped


def of_imu() -> Counter[str]:
    dropped: Counter[str] = Counter()
    upright = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    for name in NAMES:  # a run each: it is only at its first keyframe that it looks for the frame
        gravity = GravityByImu(Configuration(), ImuSource(TransformTree()), dropped)
        gravity.add(imu_message(frame_stamp(0), name, np.array([0.0, 0.0, 9.81])))
        path = OdometryPath.of([start(OdometrySample(frame_stamp(0), upright))])
        assert gravity.level_at(frame_stamp(0), path) is None
    return dropped


@pytest.mark.parametrize("counted", [beside_images, without_images, of_odometry, of_labels, of_imu])
def test_the_first_hundred_are_told_by_name_and_further_ones_together(counted: Callable[[], Counter[str]]) -> None:
    dropped = counted()
    assert dropped.total() == len(NAMES) and dropped.pop(OTHER) == len(NAMES) - MOST_REASONS
    reasons = sorted(dropped)
    assert len(reasons) == MOST_REASONS
    for name, reason in zip(NAMES, reasons, strict=False):
        assert f"'{name[:LONGEST_NAME]}'" in reason and dropped[reason] == 1


def test_a_camera_without_a_place_is_counted_by_a_short_name_too() -> None:
    info = camera_info(frame_stamp(0))
    info.header.frame_id = NAMES[0]
    assembler = PlacesAssembler(PLAIN, lambda frame: TransformTree().lookup("base_link", frame))
    assembler.add_camera_info(info)
    assembler.add_detections(to_message(detections(frame_stamp(0), BOX)))
    assembler.flush()
    (reason,) = set(assembler.dropped) - {NO_PLACE}
    assert f"to {NAMES[0][:LONGEST_NAME]}; publish {topics.TF_STATIC} or set perception.extrinsics" in reason
