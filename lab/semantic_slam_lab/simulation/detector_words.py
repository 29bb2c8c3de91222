"""A detector that calls things by names of its own: three hypotheses a box, confusions, misses, false alarms."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array

NAMES = {
    "cabinet": "refrigerator",
    "chest": "suitcase",
    "crate": "chair",
    "desk": "dining table",
    "locker": "tv",
}
"""What the detector calls furniture that its makers never saw."""
OTHERS = ("bench", "bed", "couch", "microwave", "oven", "sink")
"""Further names, which nothing in the room deserves."""
TOP, TOP_OF_ALARMS = (0.45, 0.9), (0.25, 0.6)
"""Scores of the first hypothesis, evenly: of boxes around something, and of false ones."""
SECOND, THIRD = (0.2, 0.6), (0.1, 0.5)
"""Share of what is left, and of what then is left, that the second and the third get, evenly."""
TRUTH_IS_SECOND = 0.6
"""Share of the confused boxes whose true name is the second hypothesis."""


@dataclass(frozen=True, kw_only=True)
class DetectorFaults:
    """How the detector errs."""

    confused: float = 0.2  # share of the boxes whose first hypothesis is another name
    dropped: float = 0.15  # share of the boxes that are missed
    alarms_per_frame: float = 0.1  # false ones, expected
    by_direction: bool = False  # the same object from the same side is always confused alike
    names: tuple[str, ...] = (*NAMES.values(), *OTHERS)


@dataclass(frozen=True, kw_only=True)
class Hypotheses:
    """What one box is called: (3,) names, the best first, with their scores."""

    names: tuple[str, ...]
    scores: tuple[float, ...]


SECTOR_RAD = np.pi / 4.0
"""Sides of an object that look alike to a detector that confuses by direction."""


def hypotheses(name: str, faults: DetectorFaults, random: np.random.Generator, side: Sequence[int] = ()) -> Hypotheses:
    """The hypotheses of a box of a true name; ``side`` keys the confusion of an object seen from one side."""
    confusion = np.random.default_rng(tuple(side)) if faults.by_direction and len(side) else random
    first = _other((name,), faults, confusion) if confusion.random() < faults.confused else name
    second = name if first != name and confusion.random() < TRUTH_IS_SECOND else _other((first, name), faults, random)
    third = _other((first, second), faults, random)
    return Hypotheses(names=(first, second, third), scores=tuple(_scores(TOP, random)))


def alarm(faults: DetectorFaults, random: np.random.Generator) -> Hypotheses:
    """The hypotheses of a box around nothing."""
    names = random.choice(len(faults.names), 3, replace=False)
    return Hypotheses(names=tuple(faults.names[n] for n in names), scores=tuple(_scores(TOP_OF_ALARMS, random)))


def _other(not_these: tuple[str, ...], faults: DetectorFaults, random: np.random.Generator) -> str:
    return str(random.choice([name for name in faults.names if name not in not_these]))


def _scores(tops: tuple[float, float], random: np.random.Generator) -> Array:
    top = random.uniform(*tops)
    second = min((1.0 - top) * random.uniform(*SECOND), 0.9 * top)
    third = (1.0 - top - second) * random.uniform(*THIRD)
    return np.array([top, second, min(third, 0.9 * second)])
