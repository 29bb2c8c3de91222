"""Whether the places of detections agree with odometry better if clocks, or the sensor's direction, were others."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from semantic_slam.doctor.innovations import Innovations

T = TypeVar("T")

OFFSETS_S = tuple(float(value) for value in np.arange(-5.0, 5.25, 0.5))
"""Odometry of so much later is tried."""
TURNS = {
    "backwards": np.diag([-1.0, -1.0]),
    "to the left": np.array([[0.0, -1.0], [1.0, 0.0]]),
    "to the right": np.array([[0.0, 1.0], [-1.0, 0.0]]),
    "mirrored": np.diag([1.0, -1.0]),
}
"""By what the places would have to be turned to be right."""
MUCH_BETTER = 0.6
"""Share of the distance between pairs that may be left. In 346 stretches of nine healthy drives no turn and no offset
left less; to undo a planted one leaves 0.04 to 0.6, most with many detections a frame and a robot that turns."""

LEAST_EXCESS = 0.2
"""Pairs that lie so much closer than stated disturb nobody, whatever would bring them closer."""


@dataclass(frozen=True)
class Evidence:
    """What the drive says of itself; NaN, 0 and "" where it says nothing."""

    excess: float  # by which factor pairs lie farther apart than stated
    later_s: float = 0.0  # the odometry of so much later agrees much better
    turn: str = ""  # the places agree much better when they are turned so
    ratio: float = 1.0  # of the distance between pairs then

    @classmethod
    def of(cls, innovations: Innovations) -> "Evidence":
        """The best of all that is tried, where it is much better than what is stated."""
        excess = innovations.excess()
        if not excess > LEAST_EXCESS:
            return cls(excess)
        offsets = {later_s: innovations.ratio_if_later(later_s) for later_s in OFFSETS_S if later_s}
        turns = {name: innovations.excess(turn=turn) / excess for name, turn in TURNS.items()}
        later_s, offset = _least(offsets)
        name, turned = _least(turns)
        if min(offset, turned) > MUCH_BETTER:
            return cls(excess)
        return cls(excess, turn=name, ratio=turned) if turned < offset else cls(excess, later_s=later_s, ratio=offset)


def _least(ratios: Mapping[T, float]) -> tuple[T, float]:
    """The best of all that is known, and its ratio."""
    best = min(ratios, key=lambda name: (np.isnan(ratios[name]), ratios[name]))
    return best, ratios[best] if np.isfinite(ratios[best]) else 1.0
