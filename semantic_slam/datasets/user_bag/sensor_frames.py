"""The frames of a bag in which detections state positions, and what to do about those that nothing leads to."""

from semantic_slam.errors import InputError, shortened
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages.sensor import TransformTree, plain_frame

WORLD_FRAMES = frozenset({"map", "world"})
"""Frames that stand still, beside that of the odometry."""


class SensorFrames:
    """Poses of the sensors in the body."""

    def __init__(self, base_frame: str, fixed: TransformTree, odometry: tuple[str, str]) -> None:
        """``fixed`` holds the static transforms, ``odometry`` its frame and the body's, "" where not known."""
        self._base, self._fixed = plain_frame(base_frame), fixed
        self._world, self._body = (plain_frame(frame) for frame in odometry)

    def pose(self, frame_id: str) -> Array:
        """(7,) pose of a sensor's frame in the body. Raises InputError that names the remedy."""
        if self._fixed.connects(self._base, frame_id):
            return self._fixed.lookup(self._base, frame_id)
        raise InputError(self._fault(plain_frame(frame_id)))

    def _fault(self, frame: str) -> str:
        if not frame:
            return "positions of no frame: set header.frame_id to the sensor's frame"
        if frame in WORLD_FRAMES or frame == self._world:
            return f"positions in '{frame}', a frame of the world, are not read: publish them in the sensor's frame"
        untold = f"no static transforms lead from {self._base} to {frame}"
        if self._body != self._base and self._fixed.connects(self._body, frame):
            return f"{untold}, but from the odometry's {self._body}: give --base-frame {self._body}"
        if not self._fixed.is_known:
            return f"{untold}: record /tf_static with the bag, or publish the positions in {self._base}"
        known = f"{untold}, but between {shortened(self._fixed.frames)}"
        if frame not in self._fixed.frames:
            return f"{known}: set header.frame_id to the sensor's frame, or record its transform with the bag"
        return f"{known}: give --base-frame, or record the transform that is missing with the bag"
