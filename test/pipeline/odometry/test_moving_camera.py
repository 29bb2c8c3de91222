"""A camera that moves on its robot looks from where /tf says at that instant."""

import random

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from worlds.bags.bag_factory import OPTICAL, START, camera_info, detections, image

from semantic_slam.configuration import PerceptionConfiguration, from_dict
from semantic_slam.datasets.image_folders.pictures import transform
from semantic_slam.messages.codec import to_message
from semantic_slam.messages.sensor import TransformTree
from semantic_slam.perception.classifier import Classifier
from semantic_slam.perception.frame import CameraModel, Detections, Frame
from semantic_slam.perception.range_bearing import RangeBearing
from semantic_slam.pipeline.assembly.frame_assembler import FrameAssembler

MS = 1_000_000
PERIOD = 100 * MS
BOXES = np.array([[10.0, 10.0, 30.0, 30.0]])
LEVEL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def pitched(number):
    return Rotation.from_euler("y", 0.1 * number).as_matrix() @ LEVEL


def rotation_of(pose):
    return Rotation.from_quat(pose[3:]).as_matrix()


def moving(number, parent="base_link", child=OPTICAL):
    message = transform(START + number * PERIOD, pitched(number))
    message.transforms[0].header.frame_id, message.transforms[0].child_frame_id = parent, child
    return message


def frames_of(order, fixed=None):
    """Three frames whose messages arrive in an ``order`` of their kinds; what is not there is left out."""
    assembler = FrameAssembler(from_dict({}), has_depth=False, fixed_transforms=fixed or TransformTree())
    assembler.add_camera_info(camera_info(START))
    queues = {"image": 0, "detections": 0, "tf": 0}
    frames = []
    for kind in order:
        number = queues[kind]
        queues[kind] += 1
        stamp = START + number * PERIOD
        if kind == "image":
            assembler.add_image(image(stamp, BOXES))
        elif kind == "detections":
            assembler.add_detections(to_message(detections(stamp, BOXES)))
        else:
            assembler.add_transforms(moving(number))
        frames += assembler.take()
    return frames + assembler.flush(), assembler


@pytest.mark.parametrize("seed", range(4))
def test_every_frame_has_the_pose_of_its_stamp_in_whatever_order_topics_arrive(seed):
    order = ["image", "detections", "tf"] * 3
    random.Random(seed).shuffle(order)
    frames, _ = frames_of(order)
    assert len(frames) == 3
    for number, frame in enumerate(frames):
        np.testing.assert_allclose(rotation_of(frame.T_base_camera), pitched(number), atol=1e-9)


def test_a_frame_whose_transform_is_missing_is_counted_and_not_guessed():
    frames, assembler = frames_of(["image", "detections", "tf", "image", "detections"])
    assert len(frames) == 1
    assert sum(count for reason, count in assembler.dropped.items() if "/tf" in reason) == 1


def test_a_camera_that_is_fixed_waits_for_no_transform():
    fixed = TransformTree()
    fixed.add(moving(0))
    frames, assembler = frames_of(["image", "detections"], fixed)
    assert [frame.T_base_camera for frame in frames] == [None]
    assert not assembler.dropped


def test_what_is_fixed_on_either_side_is_composed():
    fixed = TransformTree()
    fixed.add(moving(1, "base_link", "neck"))
    fixed.add(moving(2, "head", OPTICAL))
    assembler = FrameAssembler(from_dict({}), has_depth=False, fixed_transforms=fixed)
    assembler.add_camera_info(camera_info(START))
    assembler.add_transforms(moving(0, "odom", "base_link"))  # not of the camera
    assembler.add_transforms(moving(0, "neck", "head"))
    assembler.add_image(image(START, BOXES))
    assembler.add_detections(to_message(detections(START, BOXES)))
    (frame,) = assembler.take()
    np.testing.assert_allclose(rotation_of(frame.T_base_camera), pitched(1) @ pitched(0) @ pitched(2), atol=1e-9)


def measured(**told):
    camera = CameraModel(64, 48, 50.0, 50.0, 32.0, 24.0, frame_id=OPTICAL)
    of_boxes = RangeBearing(3.0, 0.3, np.diag([0.01, 0.0009]))
    classifier = Classifier(None, PerceptionConfiguration(), seed=0, range_bearing_sensor=lambda *_: of_boxes)
    seen = Detections(
        stamp_ns=1,
        frame_id=OPTICAL,
        boxes=np.array([[5.0, 5.0, 20.0, 20.0], [30.0, 5.0, 50.0, 30.0]]),
        labels=("cup", "chair"),
        scores=np.ones(2),
        track_ids=("", ""),
        **told,
    )
    frame = Frame(1, np.zeros((48, 64, 3), dtype=np.uint8), None, camera, seen)
    return classifier.measure(frame, 0, np.array([0.0, 0.0, 0.0, -0.5, 0.5, -0.5, 0.5]))


def test_places_that_detections_tell_count_before_what_their_boxes_show():
    positions = np.array([[3.0, 4.0, 0.0], [np.nan] * 3])
    covariances = np.array([0.04 * np.eye(3), np.full((3, 3), np.nan)])
    both = measured(positions=positions, position_covariances=covariances)
    np.testing.assert_allclose(both.ranges_m, [5.0, 3.0])
    np.testing.assert_allclose(both.bearings_rad, [np.arctan2(4.0, 3.0), 0.3])
    np.testing.assert_allclose(both.geometric_covariances[0], np.diag([0.04, 0.04 / 25.0]), atol=1e-12)
    np.testing.assert_allclose(both.geometric_covariances[1], np.diag([0.01, 0.0009]))
    assert np.isfinite(both.place_covariances[0]).all()
    assert np.isnan(both.place_covariances[1]).all()


def test_a_bearing_without_a_range_does_not_replace_what_depth_shows():
    both = measured(bearings_rad=np.array([0.7, np.nan]))
    np.testing.assert_allclose(both.bearings_rad, [0.3, 0.3])
