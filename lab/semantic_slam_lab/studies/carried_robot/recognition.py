"""What a robot that was carried knew, what of it it sees again, and whether it names that as it did before."""

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence

import numpy as np

from semantic_slam.evaluation.trajectory import alignment
from semantic_slam.geometry.arrays import Array

Names = Sequence[Sequence[int]]
"""K keyframes: a number for each detection, negative: of nothing."""
OFTEN = 2
"""Detections from which on an object counts as seen."""


def num_seen_again(labels: Names, carried_at: int) -> int:
    """Number of true objects that were seen before keyframe ``carried_at``, and are seen from it on."""
    before, after = (
        Counter(label for own in part for label in own) for part in (labels[:carried_at], labels[carried_at:])
    )
    return sum(label >= 0 and min(count, after[label]) >= OFTEN for label, count in before.items())


def known_before(named: Names, labels: Names, carried_at: int) -> dict[int, int]:
    """Object of a history -> true label of most of its detections before keyframe ``carried_at``."""
    votes = defaultdict[int, Counter[int]](Counter)
    for number, label in _pairs(named[:carried_at], labels):
        if number >= 0:
            votes[number][label] += 1
    return {number: own.most_common(1)[0][0] for number, own in votes.items()}


def in_map(position: Array, places: Mapping[int, Array], labels: Mapping[int, int], objects: Array) -> Array:
    """A true position (2,) in the frame of the robot's own map.

    ``places``: mapped object -> (2,); ``labels``: mapped object -> true object; ``objects`` (M, 2) true places.
    """
    both = [number for number in places if number in labels]
    mapped = np.array([places[number] for number in both]).reshape(-1, 2)
    true = objects[[labels[number] for number in both]].reshape(-1, 2)
    return np.asarray(alignment(true, mapped).applied(position[None])[0])


def share_recognised(named: Names, labels: Names, carried_at: int) -> float | None:
    """Share of the detections from keyframe ``carried_at`` on, of what was detected before, that are named alike.

    ``named``: objects of a history, which before that has each of them for what most of its detections are of, by
    their true ``labels``; None: nothing was seen again.
    """
    names = known_before(named, labels, carried_at)
    again = [pair for pair in _pairs(named[carried_at:], labels[carried_at:]) if pair[1] in names.values()]
    return sum(names.get(number) == label for number, label in again) / len(again) if again else None


def _pairs(named: Names, labels: Names) -> list[tuple[int, int]]:
    """Object, negative where it is taken for none, and label of every detection that is of something."""
    frames = zip(named, labels, strict=False)
    return [(number, label) for own, true in frames for number, label in zip(own, true, strict=True) if label >= 0]
