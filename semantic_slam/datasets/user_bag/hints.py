"""Hints given at import about contents of a bag that would cause trouble in a run, with remedies."""

from typing import Any

from semantic_slam.configuration.perception import PerceptionConfiguration
from semantic_slam.datasets.user_bag.camera_joints import CameraJoints
from semantic_slam.errors import InputError
from semantic_slam.messages import topics
from semantic_slam.messages.camera_info import USE_RECTIFIED, camera_model
from semantic_slam.messages.images import size_of
from semantic_slam.messages.sensor import TransformTree, plain_frame

FIRST = (topics.ODOMETRY, topics.CAMERA_INFO, topics.DETECTIONS, topics.IMAGE_COMPRESSED, topics.DISPARITY)
"""Topics of which the first message tells."""
SIGMA_PX = 0.25
"""Standard deviation of a good matcher's disparities."""
BODY = PerceptionConfiguration().base_frame
"""The body's frame in a run whose configuration names no other."""


class Hints:
    """Looks at the first message of each topic that is written."""

    def __init__(self, base_frame: str, fixed: TransformTree, joints: CameraJoints | None = None) -> None:
        """``base_frame`` is the body's, ``fixed`` holds the static transforms, ``joints`` lead to the camera."""
        self._base, self._fixed, self._joints = plain_frame(base_frame), fixed, joints
        self._first: dict[str, Any] = {}

    def wants(self, topic: str) -> bool:
        """Whether the next message on a topic of the new bag has to be shown to :meth:`see`."""
        return topic in FIRST and topic not in self._first

    def see(self, topic: str, message: Any) -> None:
        """The first message on a topic of the new bag."""
        self._first[topic] = message

    def lines(self, *, has_images: bool, moves_positions: bool = False) -> list[str]:
        """One line for each thing that a run would not accept, or would have to be told.

        ``moves_positions``: the import has moved positions to the body's frame.
        """
        found = [self._body(moves_positions=moves_positions)]
        if has_images:
            found += [self._camera(), self._detections(), self._size(), self._stereo(), self._rectified()]
        return [line for line in found if line]

    def _body(self, *, moves_positions: bool) -> str:
        child = self._child()
        if child in ("", BODY):
            return ""
        if self._is_exchanged():
            return f"odometry is of '{child}': exchange header.frame_id (odom) and child_frame_id (the robot's body)"
        again = f"import again with --base-frame {child} and " if moves_positions and child != self._base else ""
        name_it = f"set perception.base_frame: {child} in the configuration, or it is not used"
        return f"odometry is of '{child}': {again}{name_it}"

    def _child(self) -> str:
        """The frame whose pose the odometry gives; "" where not known."""
        odometry = self._first.get(topics.ODOMETRY)
        return plain_frame(odometry.child_frame_id) if odometry is not None else ""

    def _is_exchanged(self) -> bool:
        """Whether the odometry names the body as the frame in which poses accumulate."""
        odometry = self._first.get(topics.ODOMETRY)
        return odometry is not None and plain_frame(odometry.header.frame_id) in (BODY, self._base)

    def _body_of_a_run(self) -> str:
        """The body's frame once a user has followed the hint on it."""
        return self._base if self._is_exchanged() else self._child() or self._base

    def _camera(self) -> str:
        camera = self._first.get(topics.CAMERA_INFO)
        if camera is None:
            return ""
        try:
            camera_model(camera, topics.CAMERA_INFO)
            if self._joints is not None and (self._joints.carry_camera or self._joints.fault):
                return self._joints.fault
            if self._fixed.is_known:  # that there are none at all is said elsewhere
                self._fixed.lookup(self._body_of_a_run(), camera.header.frame_id)
        except InputError as fault:
            return str(fault)
        return ""

    def _detections(self) -> str:
        camera, detections = self._first.get(topics.CAMERA_INFO), self._first.get(topics.DETECTIONS)
        if camera is None or detections is None:
            return ""
        theirs, ours = plain_frame(detections.header.frame_id), plain_frame(camera.header.frame_id)
        if theirs == ours:
            return ""
        return (
            f"detections are of frame '{theirs}' and the camera is '{ours}': have the detector copy the image's header"
        )

    def _size(self) -> str:
        camera, image = self._first.get(topics.CAMERA_INFO), self._first.get(topics.IMAGE_COMPRESSED)
        size = size_of(image) if image is not None else None
        if camera is None or size in (None, (camera.width, camera.height)):
            return ""
        return f"images are {size[0]} x {size[1]} and camera_info says {camera.width} x {camera.height}: choose its own"

    def _stereo(self) -> str:
        pair = self._first.get(topics.DISPARITY)
        if pair is None:
            return ""
        scale = float(pair.f) * float(pair.t)  # px m, above 0: its depth was converted
        return (
            f"depth is by a stereo pair ({pair.f:g} px, {pair.t:g} m): set perception.sigma_range_per_m2:"
            f" {SIGMA_PX / scale:.2g}, for disparities known to {SIGMA_PX:g} px"
        )

    def _rectified(self) -> str:
        camera = self._first.get(topics.CAMERA_INFO)
        if camera is None or topics.DISPARITY not in self._first or not any(camera.d):
            return ""
        return f"{topics.CAMERA_INFO} states a distortion, and disparities are of rectified images: {USE_RECTIFIED}"
