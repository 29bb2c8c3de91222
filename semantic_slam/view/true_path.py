"""Recent ground-truth path of the robot."""

import math
from collections import deque

import numpy as np

from semantic_slam.messages.standard import OdometryEstimate

KEPT_TRUTH = 2000
STEP_M = 0.05
"""Points are kept at such steps."""
AHEAD_NS = 1_000_000_000
"""How long before its first keyframe a run begins, at most."""


class TruePath:
    """The newest points; those of a run may come before its first belief."""

    def __init__(self) -> None:
        self._points: deque[tuple[int, int, list[float]]] = deque(maxlen=KEPT_TRUTH)  # version, stamp, x y z

    def add(self, pose: OdometryEstimate, version: int) -> None:
        """Take in a point that is a step away; time that runs backwards is that of another run."""
        x, y, z = pose.pose[:3].tolist()
        if self._points and pose.stamp_ns < self._points[-1][1]:
            self._points.clear()
        last = self._points[-1][2] if self._points else [np.inf] * 3
        if np.isfinite([x, y, z]).all() and math.dist((x, y, z), last) >= STEP_M:
            self._points.append((version, pose.stamp_ns, [round(x, 3), round(y, 3), round(z, 3)]))

    def begin(self, stamp_ns: int) -> None:
        """Forget what was before a run that begins then."""
        while self._points and self._points[0][1] < stamp_ns - AHEAD_NS:
            self._points.popleft()

    def changed_since(self, version: int) -> list[list[float]]:
        return [point for since, _, point in self._points if since > version]
