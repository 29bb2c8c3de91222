"""Frame-to-frame tracking of boxes, for cameras with a frame rate of about 30 Hz.

A box continues the track whose predicted box it overlaps (intersection over union); a track that the detector misses
for a while is extrapolated with its last velocity. Tracks use neither labels nor the map, and end when no box continues
them.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.rows import joined_rows, with_rows
from semantic_slam.perception.boxes.same_outline import overlaps
from semantic_slam.perception.measurement import SemanticMeasurements

LEAST_OVERLAP = 0.4
"""Smallest intersection over union with the predicted box at which a box continues a track."""
NANOSECONDS = 1e9
"""Nanoseconds per second."""
LONGEST_S = 0.6
"""Longest time [s] that a track waits for its next box."""
NEW_PACE = 0.2
"""Weight of the newest step in a track's exponentially smoothed velocity."""


@dataclass(frozen=True)
class _Tracks:
    """State of T tracks: names, newest boxes and velocities."""

    names: tuple[str, ...]  # (T,)
    stamps_ns: Index  # (T,)
    boxes: Array  # (T, 4) x_min y_min x_max y_max
    paces: Array  # (T, 4) velocities of the boxes, pixels per second

    @classmethod
    def begun(cls, names: tuple[str, ...], stamp_ns: int, boxes: Array) -> "_Tracks":
        """New tracks with their first boxes (T, 4) and zero velocity."""
        return cls(names, np.full(len(names), stamp_ns), boxes, np.zeros(boxes.shape))

    def alive(self, stamp_ns: int) -> "_Tracks":
        """Tracks that still wait for a box at time ``stamp_ns``."""
        ages = stamp_ns - self.stamps_ns
        return self.take(np.flatnonzero((ages > 0) & (ages <= LONGEST_S * NANOSECONDS)))

    def take(self, rows: Index) -> "_Tracks":
        """The selected tracks."""
        return with_rows(self, rows, whole=())

    def expected(self, stamp_ns: int) -> Array:
        """(T, 4) predicted boxes at time ``stamp_ns``."""
        return np.asarray(self.boxes + self.paces * self._waited_s(stamp_ns))

    def gone_on(self, stamp_ns: int, boxes: Array) -> "_Tracks":
        """Tracks updated with their next boxes (T, 4); velocities follow the centres, as edges jitter."""
        steps = (boxes - self.boxes) / self._waited_s(stamp_ns)
        paces = np.tile(0.5 * (steps[:, :2] + steps[:, 2:]), (1, 2))
        stamps_ns = np.full(len(boxes), stamp_ns)
        return _Tracks(self.names, stamps_ns, boxes, (1.0 - NEW_PACE) * self.paces + NEW_PACE * paces)

    def _waited_s(self, stamp_ns: int) -> Array:
        """(T, 1) seconds since the newest boxes."""
        return ((stamp_ns - self.stamps_ns) / NANOSECONDS)[:, None]


class BoxTracks:
    """Assigns track names to the boxes of one camera, frame by frame."""

    STATE: ClassVar[tuple[str, ...]] = ("_tracks", "_count")

    def __init__(self) -> None:
        self._tracks = _Tracks.begun((), 0, np.zeros((0, 4)))
        self._count = 0

    def named(self, measurements: SemanticMeasurements) -> SemanticMeasurements:
        """Measurements with track ids; unchanged where detections carry some already, or none has a box."""
        boxes = measurements.boxes
        rows = np.flatnonzero(np.isfinite(boxes).all(axis=1))
        if any(measurements.track_ids) or not len(rows):
            return measurements
        names = [""] * len(boxes)
        for row, name in zip(rows.tolist(), self._follow(measurements.stamp_ns, boxes[rows]), strict=True):
            names[row] = name
        return replace(measurements, track_ids=tuple(names))

    def _follow(self, stamp_ns: int, boxes: Array) -> list[str]:
        """(n,) names of the tracks that n boxes continue or begin."""
        from scipy.optimize import linear_sum_assignment  # deferred: the import takes 0.2 s

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
