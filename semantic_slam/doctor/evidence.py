"""Test whether another clock offset or sensor orientation makes detections agree better with odometry."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.doctor.innovations import Innovations

OFFSETS_S = tuple(float(value) for value in np.arange(-5.0, 5.25, 0.5))
"""Clock offsets [s] of odometry that are tried; the end values only serve as comparison."""
TURNS = {
    "backwards": np.diag([-1.0, -1.0]),
    "to the left": np.array([[0.0, -1.0], [1.0, 0.0]]),
    "to the right": np.array([[0.0, 1.0], [-1.0, 0.0]]),
    "mirrored": np.diag([1.0, -1.0]),
}
"""By what the places would have to be turned to be right."""
MUCH_BETTER = 0.6
"""Share of the distance between pairs that may be left. In 309 stretches of twelve healthy drives no turn and no
offset left less; to undo a planted one leaves 0.04 to 0.6, least with several detections a frame and a robot that
turns."""

EXPLAINED = 1.0
"""What is right leaves pairs no farther apart than is stated."""
LEAST_EXCESS = 0.2
"""Pairs that lie so much closer than stated disturb nobody, whatever would bring them closer."""


@dataclass(frozen=True)
class Evidence:
    """Evidence of the drive for a clock offset or a rotated sensor; NaN, 0 and "" where there is none."""

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
        later_s, offset = _best_offset(innovations)
        turns = {name: innovations.excess(turn=turn) / excess for name, turn in TURNS.items()}
        name = min(turns, key=turns.__getitem__)
        ratio = min(offset, turns[name])
        if ratio > MUCH_BETTER or ratio * excess > EXPLAINED:
            return cls(excess)
        if turns[name] < offset:
            return cls(excess, turn=name, ratio=ratio)
        return cls(excess, later_s=later_s, ratio=ratio)


def _best_offset(innovations: Innovations) -> tuple[float, float]:
    """The offset at which pairs lie closest, and the ratio there; 1 where it does not stand out from all others.

    At other times odometry is interpolated, which takes noise out of it: many offsets are a little better then.
    """
    tried = np.array([innovations.ratio_if_later(later_s) for later_s in OFFSETS_S])
    known = np.flatnonzero(np.isfinite(tried))
    if not len(known):
        return 0.0, 1.0
    best = int(known[np.argmin(tried[known])])
    stands_out = tried[best] < MUCH_BETTER * np.median(tried[known]) and known[0] < best < known[-1]
    return (OFFSETS_S[best], float(tried[best])) if stands_out else (0.0, 1.0)
