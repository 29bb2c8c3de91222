"""Pose, by /tf, of a camera that moves relative to the robot, such as a panning or hand-held one."""

from collections import Counter
from typing import Any

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.transform import compose
from semantic_slam.messages import topics
from semantic_slam.messages.sensor import IDENTITY, TransformTree, plain_frame, transform_vector
from semantic_slam.messages.standard import is_pose, stamp_ns
from semantic_slam.pipeline.stamps.stamped_buffer import StampedBuffer

MAX_WAITING = 3000
"""Transforms of one pair of frames buffered while no detections arrive."""


class MovingCamera:
    """Tracks the one /tf transform between body and camera, if static transforms do not connect them."""

    def __init__(self, base_frame: str, fixed: TransformTree, dropped: Counter[str]) -> None:
        """``fixed``: static transforms, may still grow; ``dropped`` counts, by reason, unusable transforms."""
        self._base_frame, self._fixed, self._dropped = base_frame, fixed, dropped
        self._moves: dict[str, StampedBuffer[Array]] = {}  # child frame -> T_base_child

    def add(self, message: Any) -> None:
        """Store the transforms of a tf2_msgs/TFMessage whose parent frame is the body or is fixed to it."""
        for item in message.transforms:
            T_base_parent = self._between(self._base_frame, item.header.frame_id)
            if T_base_parent is None:
                continue
            pose = transform_vector(item.transform)
            if not is_pose(pose):
                self._dropped[f"{topics.TF}: transform that is not finite"] += 1
                continue
            moves = self._buffer(plain_frame(item.child_frame_id))
            moves.add(stamp_ns(item.header.stamp), compose(T_base_parent, pose))

    def go_on_from(self, former: "MovingCamera") -> None:
        """Take the transforms of this session that the object of the previous one has refused."""
        for child, moves in former._moves.items():
            self._buffer(child).go_on_from(moves)

    def _buffer(self, child: str) -> StampedBuffer[Array]:
        new: StampedBuffer[Array] = StampedBuffer(topics.TF, self._dropped, MAX_WAITING)
        return self._moves.setdefault(child, new)

    @property
    def is_holding(self) -> bool:
        """Whether a transform with a suspicious stamp is on hold until the next ones confirm or refute it."""
        return any(moves.is_holding for moves in self._moves.values())

    def is_fixed(self, optical_frame: str) -> bool:
        """Whether static transforms connect the body with the camera."""
        return self._between(self._base_frame, optical_frame) is not None

    def is_known(self, optical_frame: str, stamp_ns: int) -> bool:
        """Whether all transforms that determine the camera's pose at this stamp have arrived."""
        child, _ = self._mount(optical_frame)
        return child in self._moves and self._moves[child].has_reached(stamp_ns)

    def pose(self, optical_frame: str, stamp_ns: int, tolerance_ns: int) -> Array | None:
        """(7,) T_base_camera by the transform nearest in time; None if none is within the tolerance."""
        child, T_child_camera = self._mount(optical_frame)
        T_base_child = self._moves[child].nearest(stamp_ns, tolerance_ns) if child in self._moves else None
        return None if T_base_child is None else compose(T_base_child, T_child_camera)

    def forget_before(self, stamp_ns: int) -> None:
        """Remove the transforms before a stamp."""
        for moves in self._moves.values():
            moves.forget_before(stamp_ns)

    def release(self) -> None:
        """Accept transforms on hold, as no more will come."""
        for moves in self._moves.values():
            moves.release()

    def _mount(self, optical_frame: str) -> tuple[str, Array]:
        """Name of the moving frame to which the camera is fixed, and (7,) T_frame_camera; "" if there is none."""
        for child in self._moves:
            T_child_camera = self._between(child, optical_frame)
            if T_child_camera is not None:
                return child, T_child_camera
        return "", IDENTITY

    def _between(self, target: str, source: str) -> Array | None:
        """(7,) static T_target_source; None if no static transforms connect the two."""
        try:
            return self._fixed.lookup(target, source)
        except InputError:
            return None
