"""The part of the map that is shown."""

import numpy as np

from semantic_slam.geometry.arrays import Array

MARGIN = 0.12
"""Share of its size that is left free around what is to be seen, so that it need not grow at every keyframe."""
LEAST_MARGIN_M = 0.5
EMPTY = 0.65
"""It becomes smaller where both sides would by this factor: a map that jumps cannot be watched."""


class Extent:
    """x_min y_min x_max y_max in map, metres; grows with what is to be seen."""

    def __init__(self) -> None:
        self.box: list[float] = [-2.0, -2.0, 2.0, 2.0]
        self._is_fresh = True

    def show(self, points: Array) -> bool:
        """Have (N, 2) points be inside; whether the box became another one."""
        points = points[np.isfinite(points).all(axis=1)]
        if not len(points):
            return False
        low, high = points.min(axis=0), points.max(axis=0)
        now = np.array(self.box).reshape(2, 2)
        is_inside = bool((low >= now[0]).all() and (high <= now[1]).all())
        margin = MARGIN * float((high - low).max()) + LEAST_MARGIN_M
        is_empty = bool((high - low + 2 * margin < EMPTY * (now[1] - now[0])).all())
        if is_inside and not is_empty and not self._is_fresh:
            return False
        self._is_fresh = False
        self.box = [round(float(value), 3) for value in (*(low - margin), *(high + margin))]
        return True
