"""Odometry from TF: the transform odom -> base_link, directly or over fixed transforms of /tf_static."""

from collections import deque
from typing import Any

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.transform import compose
from semantic_slam.messages.sensor import TransformTree, plain_frame, transform_vector
from semantic_slam.messages.standard import OdometryEstimate, stamp_ns

MOST_NAMED = 20
MOST_REMEMBERED = 100
"""Newest stamps by which a repeated transform is known: an echo comes within a second or two, and what comes again
after more than so many others is of a clock that was set back."""


class TfOdometry:
    """Picks T_odom_base out of TF messages, once per stamp like tf2; ``num_repeated`` counts the others."""

    def __init__(self, odom_frame: str, base_frame: str, fixed: TransformTree) -> None:
        """``fixed`` holds the static transforms."""
        self.odom_frame = plain_frame(odom_frame)
        self.base_frame = plain_frame(base_frame)
        self._fixed = fixed
        self.num_repeated = 0
        self._stamps_ns: deque[int] = deque(maxlen=MOST_REMEMBERED)  # of the newest estimates
        self._others: set[tuple[str, str]] = set()  # (parent, child) of moving transforms that are not it

    @property
    def name(self) -> str:
        """Text that names the transform: "odom -> base_link"."""
        return f"{self.odom_frame} -> {self.base_frame}"

    @property
    def lack(self) -> str:
        """What the messages lack, and have instead: "odom -> base_link but has map -> odom"; "" once it was found."""
        if self._stamps_ns:
            return ""
        others = ", ".join(f"{parent} -> {child}" for parent, child in sorted(self._others))
        return f"{self.name} but has {others or 'nothing'}"

    def read(self, message: Any) -> list[OdometryEstimate]:
        """The odometry in one /tf message; empty when it is about other frames or repeats a stamp."""
        estimates = []
        for row in message.transforms:
            parent, child = plain_frame(row.header.frame_id), plain_frame(row.child_frame_id)
            T_child_base = self._from_base(child) if parent == self.odom_frame else None
            if T_child_base is not None:
                stamp = stamp_ns(row.header.stamp)
                if stamp in self._stamps_ns:
                    self.num_repeated += 1
                    continue
                self._stamps_ns.append(stamp)
                T_odom_base = compose(transform_vector(row.transform), T_child_base)
                estimates.append(OdometryEstimate(stamp, parent, self.base_frame, T_odom_base, np.zeros((6, 6))))
            elif len(self._others) < MOST_NAMED:
                self._others.add((parent, child))
        return estimates

    def _from_base(self, frame: str) -> Array | None:
        """T_frame_base, None where the frame is not fixed to the body."""
        try:
            return self._fixed.lookup(frame, self.base_frame)
        except InputError:
            return None
