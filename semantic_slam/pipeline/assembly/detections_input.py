"""What is received whether detections come with images or without: the detections, and the camera that took them."""

import re
from collections import Counter
from typing import Any, Self

from semantic_slam.errors import MessageError
from semantic_slam.messages import topics
from semantic_slam.messages.camera_info import camera_model
from semantic_slam.messages.codec import from_message
from semantic_slam.perception.frame import CameraModel, Detections
from semantic_slam.pipeline.stamps.stamped_buffer import StampedBuffer

TYPE_NAME = re.compile(r"^\w+/msg/\w+[.:] *")
"""Begins the texts of faults of messages."""


class DetectionsInput:
    """Detections in stamp order, and the camera of a session."""

    def __init__(self, *, rectified: bool) -> None:
        """``rectified``: whether boxes lie in rectified pictures, so that P and R of camera_info count."""
        self.camera: CameraModel | None = None  # the first camera_info; intrinsics do not change during a run
        self._rectified, self._camera_is_of_another = rectified, False
        self._lost: Counter[str] = Counter()  # messages that cannot be used, by reason
        self._told: dict[str, str] = {}  # words on arrays of other lengths, by kind
        self._detections: StampedBuffer[Detections] = StampedBuffer(topics.DETECTIONS, self._lost)

    def add_camera_info(self, message: Any) -> None:
        """Take a sensor_msgs/CameraInfo; raises InputError if the camera is not calibrated."""
        if self.camera is None or self._camera_is_of_another:
            self.camera = camera_model(message, topics.CAMERA_INFO, rectified=self._rectified)
            self._camera_is_of_another = False

    def add_detections(self, message: Any) -> None:
        """Take a semantic_slam_msgs/DetectionArray."""
        try:
            detections = from_message(message)
        except MessageError as fault:
            self._lost[f"{topics.DETECTIONS}: {self._words(fault)}"] += 1
            return
        self._detections.add(detections.stamp_ns, detections)

    def _words(self, fault: MessageError) -> str:
        """Words on an array of another length, which the first such array of each field gives."""
        told = TYPE_NAME.sub("", str(fault)).partition(";")[0]
        return self._told.setdefault(fault.kind, f"arrays of different lengths ({told})")

    def keep_camera_of(self, former: Self) -> None:
        """Use the camera of the previous session until a camera_info arrives."""
        self.camera, self._camera_is_of_another = former.camera, former.camera is not None

    def go_on_from(self, former: Self) -> None:
        """Take the messages of this session that the assembler of the previous one has refused."""
        self.keep_camera_of(former)
        self._detections.go_on_from(former._detections)
