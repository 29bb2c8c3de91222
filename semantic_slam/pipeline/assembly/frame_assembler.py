"""Assembles images, depth, camera_info and detections, which arrive in any order, into frames in stamp order.

The result depends on the messages' stamps alone. A frame is complete once the topics' clocks show which image and which
depth image are nearest in time to its detections; images without detections are never decoded.
"""

from collections.abc import Callable
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.messages import topics
from semantic_slam.messages.disparity import is_disparity
from semantic_slam.messages.images import check_unit, decode_depth, decode_image, size_of
from semantic_slam.messages.sensor import TransformTree, plain_frame
from semantic_slam.messages.standard import NANOSECONDS, header_stamp_ns
from semantic_slam.perception.frame import CameraModel, Detections, Frame
from semantic_slam.pipeline.assembly.detections_input import DetectionsInput
from semantic_slam.pipeline.odometry.moving_camera import MovingCamera
from semantic_slam.pipeline.stamps.stamped_buffer import StampedBuffer
from semantic_slam.reasons import count, quoted

MAX_IMAGES_WAITING = 300
"""Images buffered while waiting for detections; a detector with a longer latency cannot be matched."""

NO_DEPTH = "none of the detections' stamp, bearing only"
"""Why a frame is bearing-only where there is depth; follows the topic."""


class FrameAssembler(DetectionsInput):
    """Matches detections with the image and the depth image nearest in time.

    ``dropped`` counts, by reason, the messages that could not be used, except images without detections.
    """

    def __init__(
        self, configuration: Configuration, has_depth: bool, fixed_transforms: TransformTree | None = None
    ) -> None:
        """``has_depth``: whether this run has a depth topic; without it every frame is bearing-only.

        ``fixed_transforms``: those of /tf_static, if /tf may contain the motion of a camera relative to the robot.
        """
        super().__init__(rectified=configuration.perception.rectified)
        self.dropped = self._lost
        self._has_depth = has_depth
        self._base_frame = configuration.perception.base_frame
        self._moving: MovingCamera | None = None
        if fixed_transforms is not None and not configuration.perception.extrinsics:
            self._moving = MovingCamera(self._base_frame, fixed_transforms, self.dropped)
        self._tolerance_ns = round(configuration.perception.sync_tolerance_s * NANOSECONDS)
        self._images: StampedBuffer[Any] = StampedBuffer(topics.IMAGE, self.dropped, MAX_IMAGES_WAITING)
        self._depths: StampedBuffer[Any] = StampedBuffer(topics.DEPTH, self.dropped, MAX_IMAGES_WAITING)

    def add_image(self, message: Any) -> None:
        """Take a colour image, a sensor_msgs/Image or CompressedImage."""
        self._images.add(header_stamp_ns(message), message)

    def add_depth(self, message: Any) -> None:
        """Take a depth image, a sensor_msgs/Image or CompressedImage, or a stereo_msgs/DisparityImage.

        Faults of disparities are counted under topic ``disparity``, those of other depth under ``depth``.
        """
        self._depths.topic = topics.DISPARITY if is_disparity(message) else topics.DEPTH
        self._depths.add(header_stamp_ns(message), message)

    def add_transforms(self, message: Any) -> None:
        """Take a tf2_msgs/TFMessage of /tf, with time-varying transforms."""
        if self._moving is not None:
            self._moving.add(message)

    @property
    def num_waiting(self) -> int:
        """Number of detections that wait for their image or depth; 0 while a suspicious stamp is on hold.

        Otherwise a lossless replay would wait for them and not send the message that decides on the held one.
        """
        holds = self._moving is not None and self._moving.is_holding
        return 0 if holds or self._images.is_holding or self._depths.is_holding else len(self._detections)

    @property
    def is_over(self) -> bool:
        """Whether the stamps of detections and images both went back, so that another session has started."""
        return self._detections.is_set_back and self._images.is_set_back

    def go_on_from(self, former: Self) -> None:
        """Take the messages of this session that the assembler of the previous one has refused."""
        super().go_on_from(former)
        self._images.go_on_from(former._images)
        self._depths.go_on_from(former._depths)
        if self._moving is not None and former._moving is not None:
            self._moving.go_on_from(former._moving)

    def take(self) -> list[Frame]:
        """Frames that are complete, in stamp order."""
        return self._frames(at_end=False)

    def flush(self) -> list[Frame]:
        """All remaining frames, once no more messages will come."""
        for buffer in (self._detections, self._images, self._depths):
            buffer.release()
        if self._moving is not None:
            self._moving.release()
        return self._frames(at_end=True)

    def _frames(self, at_end: bool) -> list[Frame]:
        frames = []
        while len(self._detections) and (at_end or self._is_decided(self._detections.first()[0])):
            detections = self._detections.pop()
            frame = self._frame(detections)
            if frame is not None:
                frames.append(frame)
            self._images.forget_before(detections.stamp_ns - self._tolerance_ns)
            self._depths.forget_before(detections.stamp_ns - self._tolerance_ns)
            if self._moving is not None:
                self._moving.forget_before(detections.stamp_ns - self._tolerance_ns)
        return frames

    def _is_decided(self, stamp_ns: int) -> bool:
        buffers = [self._images, self._depths] if self._has_depth else [self._images]
        if self.camera is None or not all(buffer.has_reached(stamp_ns) for buffer in buffers):
            return False
        moving = self._moving_camera(self.camera)
        return moving is None or moving.is_known(self.camera.frame_id, stamp_ns)

    def _frame(self, detections: Detections) -> Frame | None:
        """The frame of these detections; None, counted, if image, camera or transform is missing or wrong."""
        camera, image = self.camera, self._images.nearest(detections.stamp_ns, self._tolerance_ns)
        fault = _fault(detections, camera, image)
        if fault or camera is None:
            count(self.dropped, fault)
            return None
        pixels = self._pixels(decode_image, image, topics.IMAGE, camera)
        if pixels is None:
            return None
        stamp_ns, moving = detections.stamp_ns, self._moving_camera(camera)
        T_base_camera = None if moving is None else moving.pose(camera.frame_id, stamp_ns, self._tolerance_ns)
        if moving is not None and T_base_camera is None:
            link = f"from {self._base_frame} to {quoted(camera.frame_id)}"
            count(self.dropped, f"{topics.DETECTIONS}: no {topics.TF} {link} then")
            return None
        return Frame(stamp_ns, pixels, self._depth(stamp_ns, camera), camera, detections, T_base_camera)

    def _moving_camera(self, camera: CameraModel) -> MovingCamera | None:
        """Source of the pose of a camera that moves on the robot; None if the camera is fixed."""
        return None if self._moving is None or self._moving.is_fixed(camera.frame_id) else self._moving

    def _depth(self, stamp_ns: int, camera: CameraModel) -> NDArray[np.float32] | None:
        """Depth image [m] for this stamp; None, counted, if it is missing or broken: the frame is bearing-only."""
        if not self._has_depth:
            return None
        message = self._depths.nearest(stamp_ns, self._tolerance_ns)
        if message is None:
            self.dropped[f"{self._depths.topic}: {NO_DEPTH}"] += 1
            return None
        return self._pixels(_depth_in_metres, message, self._depths.topic, camera)

    def _pixels(
        self, decode: Callable[[Any, str], NDArray[Any]], message: Any, topic: str, camera: CameraModel
    ) -> NDArray[Any] | None:
        """Decoded image of the camera's size; None, counted, if it does not decode or has another size."""
        try:
            self._check_size(size_of(message), topic, camera)
            pixels = decode(message, topic)
            self._check_size((pixels.shape[1], pixels.shape[0]), topic, camera)
        except InputError as error:
            count(self.dropped, str(error))
            return None
        return pixels

    def _check_size(self, size: tuple[int, int] | None, topic: str, camera: CameraModel) -> None:
        """Raises InputError if the size is known and not the camera's."""
        if size is not None and size != (camera.width, camera.height):
            expected = f"{camera.width} x {camera.height} of {topics.CAMERA_INFO}"
            raise InputError(f"{topic}: size {size[0]} x {size[1]} is not the {expected}")


def _depth_in_metres(message: Any, topic: str) -> NDArray[np.float32]:
    depth_m = decode_depth(message, topic)
    check_unit(depth_m, message, topic)
    return depth_m


def _fault(detections: Detections, camera: CameraModel | None, image: Any) -> str:
    """Why no frame can be made; "" if one can."""
    if camera is None:
        return f"{topics.DETECTIONS}: no {topics.CAMERA_INFO} came"
    if plain_frame(detections.frame_id) != plain_frame(camera.frame_id):
        own, expected = quoted(detections.frame_id), quoted(camera.frame_id)
        return f"{topics.DETECTIONS}: frame id {own} is not the camera's {expected}"
    return f"{topics.DETECTIONS}: no {topics.IMAGE} of their stamp" if image is None else ""
