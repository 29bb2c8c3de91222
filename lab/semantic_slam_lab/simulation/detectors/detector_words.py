"""A detector that calls things by names of its own: three hypotheses a box, confusions, misses, false alarms."""

from dataclasses import dataclass, field

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.simulation.detectors.detector_boxes import BoxFaults

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


BY_CHANCE, BY_SIDE, BY_VIEW = "chance", "side", "view"
"""What is confused: any box; an object from some sides of it, always alike; a class from some direction, mostly alike.

The first two differ from bag to bag; the last is that detector's way, which other bags teach.
"""
SHARPNESS = 2.0
"""Concentration of the directions in which a class is confused: from the worst one three times as often as on average.
"""
PARTNER_SHARE = 0.8
"""Share of a class's confusions, by view, with the one name that it looks like from there."""


@dataclass(frozen=True, kw_only=True)
class DetectorFaults:
    """How the detector errs."""

    confused: float = 0.2  # share of the boxes whose first hypothesis is another name
    dropped: float = 0.15  # share of the boxes that are missed
    alarms_per_frame: float = 0.1  # false ones, expected
    confusion: str = BY_CHANCE
    boxes: BoxFaults = field(default_factory=BoxFaults)
    names: tuple[str, ...] = (*NAMES.values(), *OTHERS)


@dataclass(frozen=True, kw_only=True)
class Hypotheses:
    """What one box is called: (3,) names, the best first, with their scores."""

    names: tuple[str, ...]
    scores: tuple[float, ...]


SECTORS = 8
"""Sides of an object that look alike to a detector that confuses by side."""


@dataclass(frozen=True, kw_only=True)
class Seen:
    """One object as it is looked at."""

    name: str  # the true one
    number: int  # of the object
    azimuth_rad: float  # direction of the camera in the object's frame


def hypotheses(seen: Seen, faults: DetectorFaults, random: np.random.Generator, detector: int = 0) -> Hypotheses:
    """The hypotheses of a box; ``detector`` keys what it confuses by side or by view."""
    name = seen.name
    first = _first(seen, faults, random, detector)
    second = name if first != name and random.random() < TRUTH_IS_SECOND else _other((first, name), faults, random)
    third = _other((first, second), faults, random)
    return Hypotheses(names=(first, second, third), scores=tuple(_scores(TOP, random)))


def _first(seen: Seen, faults: DetectorFaults, random: np.random.Generator, detector: int) -> str:
    """The first hypothesis."""
    if faults.confusion == BY_VIEW:
        return _by_view(seen, faults, random, detector)
    if faults.confusion == BY_SIDE:
        sector = int(np.floor(seen.azimuth_rad / (2.0 * np.pi / SECTORS))) % SECTORS
        random = np.random.default_rng((detector, seen.number, sector))
    return _other((seen.name,), faults, random) if random.random() < faults.confused else seen.name


def _by_view(seen: Seen, faults: DetectorFaults, random: np.random.Generator, detector: int) -> str:
    """More often wrong the nearer the view is to the direction in which the class looks like another."""
    way = np.random.default_rng((detector, *seen.name.encode()))
    worst, partner = way.uniform(-np.pi, np.pi), _other((seen.name,), faults, way)
    share = faults.confused * np.exp(SHARPNESS * np.cos(seen.azimuth_rad - worst)) / np.i0(SHARPNESS)
    if random.random() >= share:
        return seen.name
    return partner if random.random() < PARTNER_SHARE else _other((seen.name, partner), faults, random)


def other_hypotheses(seen: Seen, faults: DetectorFaults, random: np.random.Generator) -> Hypotheses:
    """The hypotheses of a second box around what has one already: another name, then perhaps the true one."""
    first = _other((seen.name,), faults, random)
    second = seen.name if random.random() < TRUTH_IS_SECOND else _other((first, seen.name), faults, random)
    names = (first, second, _other((first, second), faults, random))
    return Hypotheses(names=names, scores=tuple(_scores(TOP_OF_ALARMS, random)))


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
