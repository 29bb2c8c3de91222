"""Whether objects exist as often as an open world says, when it first states them and when it last does."""

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.configuration import Configuration, load_configuration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.shipped import configuration_file
from semantic_slam_lab.studies.aliased_room.metrics import matched
from semantic_slam_lab.studies.faulty_rooms.open_room import FALSE_ALARM, OpenRoom, open_room

BINS = 10
DRAWS, LEVEL = 2000, 0.01
"""Settings of the bootstrap over rooms, and of its intervals."""
LEAST_ENTRIES = 20
"""Entries of a bin that is judged."""
STATED, NEAR_M = 0.5, 1.0
"""An object is a ghost if it is stated with more than the first, and stands for no true one nearer than the second."""
AGAIN = 2
"""Detections from which on what an object is follows from most of them."""
START_SIGMA = (0.01, 0.01, 0.01)


@dataclass(frozen=True, kw_only=True)
class Judged:
    """What was said of existence in one room: N entries, one for each object and occasion."""

    stated: tuple[float, ...]  # N
    exists: tuple[bool, ...]  # N
    is_first: tuple[bool, ...]  # N: of two occasions
    ghosts: int = 0  # objects at the end that are none
    ghosts_expected: float = 0.0  # by what is stated of those objects


def configuration() -> Configuration:
    """``config/open_world.yaml``."""
    return load_configuration(configuration_file("open_world"))


def judged_room(num_keyframes: int, random: np.random.Generator) -> Judged:
    """Draw a room, drive through it and judge every object that was ever stated."""
    room = open_room(configuration(), num_keyframes, random)
    engine = Engine(configuration(), initial_pose=room.truth[0], initial_covariance=np.diag(START_SIGMA) ** 2)
    first: dict[int, float] = {}
    last: dict[int, float] = {}
    started: dict[int, bool] = {}
    seen: dict[int, Counter[int]] = defaultdict(Counter)  # object -> of what its detections are, in the best history
    for keyframe, labels in zip(room.keyframes, room.labels, strict=True):
        belief = engine.process(keyframe)
        begin = engine.registry.first_new_id(belief.keyframe)
        started |= {begin + row: _is_first_sight(room, belief.keyframe, label) for row, label in enumerate(labels)}
        told = dict(zip(belief.object_ids.tolist(), belief.existence.tolist(), strict=True))
        first |= {number: value for number, value in told.items() if number not in first}
        last |= told
        for number, label in zip(belief.hypotheses[0].associations, labels, strict=True):
            seen[number][label] += 1
    return Judged(
        stated=(*first.values(), *last.values()),
        exists=(*(started[number] for number in first), *(_stands_for_one(number, seen, started) for number in last)),
        is_first=(True,) * len(first) + (False,) * len(last),
        ghosts=_ghosts(belief, room),
        ghosts_expected=float((1.0 - belief.existence[belief.existence > STATED]).sum()),
    )


def _is_first_sight(room: OpenRoom, keyframe: int, label: int) -> bool:
    """Whether a detection is the first one of a true object: then what it started is that object."""
    return label != FALSE_ALARM and all(label not in labels for labels in room.labels[:keyframe])


def _stands_for_one(number: int, seen: Mapping[int, Counter[int]], started: Mapping[int, bool]) -> bool:
    """Whether most of an object's detections are of one true object, of which no other object has more.

    What was started by a true object's first detection, and not seen again, is that object.
    """
    if number not in seen or sum(seen[number].values()) < AGAIN:
        return started[number]
    label, count = seen[number].most_common(1)[0]
    return label != FALSE_ALARM and all(other[label] <= count for other in seen.values())


def _ghosts(belief: HybridBelief, room: OpenRoom) -> int:
    """Stated objects that stand for no true one; pairs are one to one, so that a second copy is a ghost, too."""
    stated = belief.object_poses[belief.existence > STATED, :2]
    return len(stated) - int((matched(stated, room.objects, NEAR_M) >= 0).sum())


@dataclass(frozen=True, kw_only=True)
class Bin:
    """Entries whose stated probability lies in one tenth."""

    mean: float  # stated
    share: float  # that exists
    count: int
    credible: bool | None  # within the 99 % interval of the number that exists; None: too few entries


def reliability(rooms: Sequence[Judged], random: np.random.Generator) -> list[Bin]:
    """Bins of all entries; rooms are drawn anew, and each entry of theirs exists as often as stated.

    Entries of one room are not independent: in each draw of the rooms the excess of what exists over what was stated
    scatters about its mean as it does between rooms.
    """
    stated, exists, room = _pooled(rooms)
    place = np.clip((stated * BINS).astype(int), 0, BINS - 1)
    rows = []
    for own in np.unique(place):
        chosen = place == own
        count = int(chosen.sum())
        rows.append(
            Bin(
                mean=float(stated[chosen].mean()),
                share=float(exists[chosen].mean()),
                count=count,
                credible=_is_credible(stated[chosen], exists[chosen], room[chosen], len(rooms), random)
                if count >= LEAST_ENTRIES
                else None,
            )
        )
    return rows


def calibration_error(bins: Sequence[Bin]) -> float:
    """Expected calibration error: mean distance of share from mean, by the number of entries."""
    counts = np.array([own.count for own in bins])
    return float(counts @ np.abs([own.mean - own.share for own in bins]) / counts.sum())


def _pooled(rooms: Sequence[Judged]) -> tuple[Array, Array, Array]:
    stated = np.concatenate([own.stated for own in rooms])
    exists = np.concatenate([own.exists for own in rooms]).astype(float)
    return stated, exists, np.repeat(np.arange(len(rooms)), [len(own.stated) for own in rooms])


def _is_credible(stated: Array, exists: Array, room: Array, count: int, random: np.random.Generator) -> bool:
    """Whether the excess of what exists lies in the interval that binomial numbers and rooms drawn anew leave it."""
    excess = np.bincount(room, exists - stated, count)
    drawn = excess[random.integers(count, size=(DRAWS, count))].sum(axis=1)
    binomial = random.random((DRAWS, len(stated))) < stated
    scatter = np.concatenate([drawn - drawn.mean(), binomial.sum(axis=1) - stated.sum()])
    low, high = np.quantile(scatter, [0.5 * LEVEL, 1.0 - 0.5 * LEVEL])
    return bool(low <= excess.sum() <= high)
