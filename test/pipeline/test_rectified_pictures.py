"""Rectified pictures, which come with the camera_info of the raw ones, tell the same directions and distances."""

from functools import partial
from typing import Any

import cv2
import numpy as np
import pytest
from worlds.bags.bag_factory import OPTICAL, T_BASE_CAMERA, camera_info, detections

from semantic_slam.configuration import Configuration, from_dict
from semantic_slam.errors import MessageError
from semantic_slam.geometry.pose import transform_points
from semantic_slam.messages.camera_info import camera_model
from semantic_slam.messages.codec import to_message
from semantic_slam.perception.classifier import Classifier
from semantic_slam.perception.frame import Frame
from semantic_slam.perception.range_bearing import range_and_bearing
from semantic_slam.pipeline.assembly.places_assembler import PlacesAssembler

K = np.array([[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]])
D = np.array([-0.3, 0.08, 0.001, -0.002, 0.0])
R = cv2.Rodrigues(np.array([0.02, -0.05, 0.03]))[0]
P = np.array([[500.0, 0.0, 310.0, 0.0], [0.0, 505.0, 235.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
POINTS = np.array([[0.7, 0.2, 2.0], [-0.6, -0.4, 2.5], [0.0, 0.1, 1.5]])
"""Points in the frame of the raw camera [m]."""
IN_BODY = transform_points(T_BASE_CAMERA, POINTS)
IN_RECTIFIED = POINTS @ R.T
PIXELS = {
    False: cv2.projectPoints(POINTS, np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2),
    True: (IN_RECTIFIED @ P[:, :3].T)[:, :2] / IN_RECTIFIED[:, 2:],
}
"""Where the points appear in raw (False) and rectified (True) pictures, by the definition of sensor_msgs/CameraInfo."""


def info(**changes: Any) -> Any:
    message = camera_info(1)
    message.width, message.height, message.d = 640, 480, D
    message.k, message.r, message.p = K.ravel(), R.ravel(), P.ravel()
    for name, value in changes.items():
        setattr(message, name, value)
    return message


def configured(rectified: bool, state_space: str = "planar") -> Configuration:
    perception = {"rectified": rectified, "depth_to_width": 0.0}
    return from_dict({"perception": perception, "state_space": state_space, "semantic_model": {"kind": "none"}})


def boxes_about(pixels: np.ndarray) -> np.ndarray:
    return np.hstack([pixels - 10.0, pixels + 10.0])


@pytest.mark.parametrize("rectified", [False, True])
def test_boxes_tell_the_directions_from_the_raw_cameras_frame(rectified: bool) -> None:
    assembler = PlacesAssembler(configured(rectified), lambda _: T_BASE_CAMERA)
    assembler.add_camera_info(info())
    assembler.add_detections(to_message(detections(1, boxes_about(PIXELS[rectified]))))
    (measured,) = assembler.flush()
    seen = IN_BODY - T_BASE_CAMERA[:3]
    np.testing.assert_allclose(measured.bearings_rad, np.arctan2(seen[:, 1], seen[:, 0]), atol=1e-5)


def test_depth_lies_along_the_axis_of_the_rectified_camera() -> None:
    configuration = configured(rectified=True)
    boxes, depth_m = boxes_about(PIXELS[True]), np.full((480, 640), np.nan, dtype=np.float32)
    for (left, top, right, bottom), point in zip(boxes.astype(int), IN_RECTIFIED, strict=True):
        depth_m[top:bottom, left:right] = point[2]
    camera = camera_model(info(), "camera_info", rectified=True)
    frame = Frame(1, np.zeros((480, 640, 3), np.uint8), depth_m, camera, detections(1, boxes))
    sensor = partial(range_and_bearing, configuration=configuration.perception)
    classifier = Classifier(None, configuration.perception, seed=0, range_bearing_sensor=sensor)
    measured = classifier.measure(frame, 0, T_BASE_CAMERA)
    np.testing.assert_allclose(measured.ranges_m, np.hypot(*IN_BODY[:, :2].T), rtol=1e-6)
    np.testing.assert_allclose(measured.bearings_rad, np.arctan2(IN_BODY[:, 1], IN_BODY[:, 0]), atol=1e-6)


def test_a_lens_that_is_not_known_is_no_matter_once_its_pictures_are_rectified() -> None:
    fisheye = info(distortion_model="equidistant", d=np.array([0.1, 0.01, 0.0, 0.0]))
    with pytest.raises(MessageError, match=r"not known \('equidistant'\); use rectified .*perception.rectified: true"):
        camera_model(fisheye, "camera_info")
    camera = camera_model(fisheye, "camera_info", rectified=True)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (500.0, 505.0, 310.0, 235.0)
    assert camera.distortion == () and camera.frame_id == OPTICAL


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"p": np.zeros(12)}, r"P tells no rectified picture \(fx 0, fy 0\); calibrate .* perception.rectified: false"),
        ({"p": np.full(12, np.nan)}, "P tells no rectified picture"),
        ({"r": np.zeros(9)}, "R is not a rotation"),
        ({"r": np.diag([1.0, 1.0, -1.0]).ravel()}, "R is not a rotation"),
    ],
)
def test_a_rectification_that_is_none_is_refused(wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(MessageError, match=words):
        camera_model(info(**wrong), "camera_info", rectified=True)
