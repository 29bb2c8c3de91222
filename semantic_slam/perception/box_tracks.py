"""Boxes that follow one another from frame to frame: a camera that gives thirty frames a second shows which are of one
thing.

Each box goes on where its track lets expect it, by the share that both overlap; what a detector misses for a while goes
on as it moved last. A track knows no names and no map, and ends where nothing goes on with it.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from semantic_slam.geometry.arrays import Array
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.perception.same_outline import overlaps

LEAST_OVERLAP = 0.4
"""Intersection over union with the expected box, from which on a box goes on with a track."""
NANOSECONDS = 1e9
"""In a second."""
LONGEST_S = 0.6
"""For how long a track waits for its next box."""
NEW_PACE = 0.2
"""Share of the newest step in how fast a track is taken to move."""


@dataclass(frozen=True)
class Track:
    """The newest box of a track."""

    name: str
    stamp_ns: int
    box: Array  # (4,) x_min y_min x_max y_max
    pace: Array  # (4,) pixels per second by which the box moves

    def expected(self, stamp_ns: int) -> Array:
        """(4,) the box at an instant."""
        return np.asarray(self.box + self.pace * ((stamp_ns - self.stamp_ns) / NANOSECONDS))

    def gone_on(self, stamp_ns: int, box: Array) -> "Track":
        """With its next box, which moves as its middle does: its edges tremble."""
        step = (box - self.box) / ((stamp_ns - self.stamp_ns) / NANOSECONDS)
        pace = np.tile(0.5 * (step[:2] + step[2:]), 2)
        return Track(self.name, stamp_ns, box, (1.0 - NEW_PACE) * self.pace + NEW_PACE * pace)


class BoxTracks:
    """Gives the boxes of one camera, frame by frame, the names of their tracks."""

    def __init__(self) -> None:
        self._tracks: list[Track] = []
        self._count = 0

    def named(self, measurements: SemanticMeasurements) -> SemanticMeasurements:
        """With track ids of the boxes; as they are where detections carry some, or none has a box."""
        boxes = measurements.boxes
        rows = np.flatnonzero(np.isfinite(boxes).all(axis=1))
        if any(measurements.track_ids) or not len(rows):
            return measurements
        names = [""] * len(boxes)
        for row, track in zip(rows.tolist(), self._follow(measurements.stamp_ns, boxes[rows]), strict=True):
            names[row] = track.name
        return replace(measurements, track_ids=tuple(names))

    def _follow(self, stamp_ns: int, boxes: Array) -> list[Track]:
        """(n,) the tracks that n boxes go on with, or begin."""
        alive = [own for own in self._tracks if 0 < stamp_ns - own.stamp_ns <= LONGEST_S * NANOSECONDS]
        expected = np.array([own.expected(stamp_ns) for own in alive]).reshape(-1, 4)
        shared = overlaps(expected, boxes)
        pairs = zip(*linear_sum_assignment(-shared), strict=True)
        before = {int(row): int(track) for track, row in pairs if shared[track, row] >= LEAST_OVERLAP}
        found = [
            alive[before[row]].gone_on(stamp_ns, box) if row in before else self._begun(stamp_ns, box)
            for row, box in enumerate(boxes)
        ]
        waiting = [own for number, own in enumerate(alive) if number not in before.values()]
        self._tracks = [*waiting, *found]
        return found

    def _begun(self, stamp_ns: int, box: Array) -> Track:
        self._count += 1
        return Track(f"{self._count}", stamp_ns, box, np.zeros(4))
