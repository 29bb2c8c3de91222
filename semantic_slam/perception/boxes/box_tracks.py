"""Boxes that follow one another from frame to frame: a camera that gives thirty frames a second shows which are of one
thing.

Each box goes on where its track lets expect it, by the share that both overlap; what a detector misses for a while goes
on as it moved last. A track knows no names and no map, and ends where nothing goes on with it.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.rows import joined_rows, with_rows
from semantic_slam.perception.boxes.same_outline import overlaps
from semantic_slam.perception.measurement import SemanticMeasurements

LEAST_OVERLAP = 0.4
"""Intersection over union with the expected box, from which on a box goes on with a track."""
NANOSECONDS = 1e9
"""In a second."""
LONGEST_S = 0.6
"""For how long a track waits for its next box."""
NEW_PACE = 0.2
"""Share of the newest step in how fast a track is taken to move."""


@dataclass(frozen=True)
class _Tracks:
    """The newest boxes of T tracks."""

    names: tuple[str, ...]  # (T,)
    stamps_ns: Index  # (T,)
    boxes: Array  # (T, 4) x_min y_min x_max y_max
    paces: Array  # (T, 4) pixels per second by which the boxes move

    @classmethod
    def begun(cls, names: tuple[str, ...], stamp_ns: int, boxes: Array) -> "_Tracks":
        """With their first boxes (T, 4)."""
        return cls(names, np.full(len(names), stamp_ns), boxes, np.zeros(boxes.shape))

    def alive(self, stamp_ns: int) -> "_Tracks":
        """The tracks that still wait for a box at an instant."""
        ages = stamp_ns - self.stamps_ns
        return self.take(np.flatnonzero((ages > 0) & (ages <= LONGEST_S * NANOSECONDS)))

    def take(self, rows: Index) -> "_Tracks":
        """Some of them."""
        return with_rows(self, rows, whole=())

    def expected(self, stamp_ns: int) -> Array:
        """(T, 4) the boxes at an instant."""
        return np.asarray(self.boxes + self.paces * self._waited_s(stamp_ns))

    def gone_on(self, stamp_ns: int, boxes: Array) -> "_Tracks":
        """With their next boxes (T, 4), which move as their middles do: their edges tremble."""
        steps = (boxes - self.boxes) / self._waited_s(stamp_ns)
        paces = np.tile(0.5 * (steps[:, :2] + steps[:, 2:]), (1, 2))
        stamps_ns = np.full(len(boxes), stamp_ns)
        return _Tracks(self.names, stamps_ns, boxes, (1.0 - NEW_PACE) * self.paces + NEW_PACE * paces)

    def _waited_s(self, stamp_ns: int) -> Array:
        """(T, 1) seconds since the newest boxes."""
        return ((stamp_ns - self.stamps_ns) / NANOSECONDS)[:, None]


class BoxTracks:
    """Gives the boxes of one camera, frame by frame, the names of their tracks."""

    def __init__(self) -> None:
        self._tracks = _Tracks.begun((), 0, np.zeros((0, 4)))
        self._count = 0

    def named(self, measurements: SemanticMeasurements) -> SemanticMeasurements:
        """With track ids of the boxes; as they are where detections carry some, or none has a box."""
        boxes = measurements.boxes
        rows = np.flatnonzero(np.isfinite(boxes).all(axis=1))
        if any(measurements.track_ids) or not len(rows):
            return measurements
        names = [""] * len(boxes)
        for row, name in zip(rows.tolist(), self._follow(measurements.stamp_ns, boxes[rows]), strict=True):
            names[row] = name
        return replace(measurements, track_ids=tuple(names))

    def _follow(self, stamp_ns: int, boxes: Array) -> list[str]:
        """(n,) names of the tracks that n boxes go on with, or begin."""
        alive = self._tracks.alive(stamp_ns)
        shared = overlaps(alive.expected(stamp_ns), boxes)
        tracks, rows = linear_sum_assignment(-shared)
        goes_on = shared[tracks, rows] >= LEAST_OVERLAP
        tracks, rows = tracks[goes_on], rows[goes_on]
        new = np.delete(np.arange(len(boxes)), rows)
        waiting = np.delete(np.arange(len(alive.names)), tracks)
        found = joined_rows([alive.take(tracks).gone_on(stamp_ns, boxes[rows]), self._begun(stamp_ns, boxes[new])], ())
        found = found.take(np.argsort(np.concatenate([rows, new])))
        self._tracks = joined_rows([alive.take(waiting), found], ())
        return list(found.names)

    def _begun(self, stamp_ns: int, boxes: Array) -> _Tracks:
        names = tuple(f"{self._count + 1 + number}" for number in range(len(boxes)))
        self._count += len(boxes)
        return _Tracks.begun(names, stamp_ns, boxes)
