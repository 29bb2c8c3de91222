"""A drive at speeds that change every second, and what odometry tells of it by a clock that is off."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array

PHASE_S = 1.0
"""Seconds at one speed."""
MOST_SPEED_M_S, MOST_TURN_RAD_S = 0.6, 0.6


@dataclass(frozen=True)
class Path:
    """Odometry's poses as a function of time; at rest before 0 and after its last phase."""

    twists: Array  # (P, 3) velocities ahead, to the left [m/s] and about [rad/s] in each phase
    corners: Array  # (P + 1, 3) poses between the phases, the first one 0

    @classmethod
    def drawn(cls, random: np.random.Generator, duration_s: float) -> "Path":
        """Speeds drawn evenly."""
        count = int(np.ceil(duration_s / PHASE_S))
        speeds = random.uniform(0.0, MOST_SPEED_M_S, size=count)
        turns = random.uniform(-MOST_TURN_RAD_S, MOST_TURN_RAD_S, size=count)
        twists = np.stack([speeds, np.zeros(count), turns], axis=1)
        corners = [np.zeros(3)]
        for twist in twists:
            corners.append(se2.compose(corners[-1], se2.exp(PHASE_S * twist)))
        return cls(twists, np.array(corners))

    def pose(self, time_s: float) -> Array:
        """(3,) at an instant."""
        phase = int(np.clip(time_s // PHASE_S, 0, len(self.twists) - 1))
        inside = float(np.clip(time_s - phase * PHASE_S, 0.0, PHASE_S))
        return np.asarray(se2.compose(self.corners[phase], se2.exp(inside * self.twists[phase])))

    def motion(self, start_s: float, end_s: float) -> Array:
        """(3,) between two instants."""
        return np.asarray(se2.between(self.pose(start_s), self.pose(end_s)))

    def extent(self, start_s: float, end_s: float) -> tuple[float, float]:
        """Metres driven and radians turned between two instants."""
        edges = np.arange(len(self.twists)) * PHASE_S
        spent = np.clip(end_s - edges, 0.0, PHASE_S) - np.clip(start_s - edges, 0.0, PHASE_S)
        return float(spent @ np.abs(self.twists[:, 0])), float(spent @ np.abs(self.twists[:, 2]))
