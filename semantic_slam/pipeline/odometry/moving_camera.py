"""Where a camera that moves on its robot looks from at each instant, by /tf: one that is held by hand, or pans."""

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
"""Transforms of one pair of frames that are kept while no detections come."""


class MovingCamera:
    """The one transform of /tf that lies between body and camera, where the static ones do not connect them."""

    def __init__(self, base_frame: str, fixed: TransformTree, dropped: Counter[str]) -> None:
        """``fixed`` may still grow; ``dropped`` counts, by reason, transforms that cannot be used."""
        self._base_frame, self._fixed, self._dropped = base_frame, fixed, dropped
        self._moves: dict[str, StampedBuffer[Array]] = {}  # child frame -> T_base_child

    def add(self, message: Any) -> None:
        """Remember the transforms of a tf2_msgs/TFMessage that begin at the body, or at what is fixed to it."""
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
        """Take what another one has refused because it is of this session."""
        for child, moves in former._moves.items():
            self._buffer(child).go_on_from(moves)

    def _buffer(self, child: str) -> StampedBuffer[Array]:
        new: StampedBuffer[Array] = StampedBuffer(topics.TF, self._dropped, MAX_WAITING)
        return self._moves.setdefault(child, new)

    @property
    def is_holding(self) -> bool:
        """Whether a transform is held aside until the next ones tell whether its stamp is right."""
        return any(moves.is_holding for moves in self._moves.values())

    def is_fixed(self, optical_frame: str) -> bool:
        """Whether static transforms tell where the camera is."""
        return self._between(self._base_frame, optical_frame) is not None

    def is_known(self, optical_frame: str, stamp_ns: int) -> bool:
        """Whether no more transforms will come that tell where the camera is at this stamp."""
        child, _ = self._mount(optical_frame)
        return child in self._moves and self._moves[child].has_reached(stamp_ns)

    def pose(self, optical_frame: str, stamp_ns: int, tolerance_ns: int) -> Array | None:
        """(7,) T_base_camera by the transform nearest in time; None where none is near."""
        child, T_child_camera = self._mount(optical_frame)
        T_base_child = self._moves[child].nearest(stamp_ns, tolerance_ns) if child in self._moves else None
        return None if T_base_child is None else compose(T_base_child, T_child_camera)

    def forget_before(self, stamp_ns: int) -> None:
        """Remove what lies before a stamp."""
        for moves in self._moves.values():
            moves.forget_before(stamp_ns)

    def release(self) -> None:
        """No more will come."""
        for moves in self._moves.values():
            moves.release()

    def _mount(self, optical_frame: str) -> tuple[str, Array]:
        """The frame that moves and that the camera is fixed to, and T_frame_camera."""
        for child in self._moves:
            T_child_camera = self._between(child, optical_frame)
            if T_child_camera is not None:
                return child, T_child_camera
        return "", IDENTITY

    def _between(self, target: str, source: str) -> Array | None:
        """Fixed T_target_source; None where nothing fixed connects the two."""
        try:
            return self._fixed.lookup(target, source)
        except InputError:
            return None
