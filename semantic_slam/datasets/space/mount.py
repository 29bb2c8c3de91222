"""The camera of a body that is the camera: its mount and its intrinsics, told once."""

from collections.abc import Iterator

from semantic_slam.datasets.drives.drive import Message
from semantic_slam.datasets.frames import BODY_FRAME, CAMERA_FRAME
from semantic_slam.datasets.scene_messages import camera_info, static_transform
from semantic_slam.messages import topics
from semantic_slam.perception.frame import CameraModel


def mounted(camera: CameraModel, stamp_ns: int) -> Iterator[Message]:
    """/tf_static and camera_info."""
    yield stamp_ns, topics.TF_STATIC, static_transform(stamp_ns, BODY_FRAME, CAMERA_FRAME, 0.0)
    yield stamp_ns, topics.CAMERA_INFO, camera_info(camera, 1.0, stamp_ns, CAMERA_FRAME)
