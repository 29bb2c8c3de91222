"""Whether a robot that was carried names what it sees again as it did before."""

from collections import Counter, defaultdict
from collections.abc import Sequence

Names = Sequence[Sequence[int]]
"""K keyframes: a number for each detection, negative: of nothing."""


def share_recognised(named: Names, labels: Names, carried_at: int) -> float | None:
    """Share of the detections from keyframe ``carried_at`` on, of what was detected before, that are named alike.

    ``named``: objects of a history, which before that has each of them for what most of its detections are of, by
    their true ``labels``; None: nothing was seen again.
    """
    votes = defaultdict[int, Counter[int]](Counter)
    for number, label in _pairs(named[:carried_at], labels):
        if number >= 0:
            votes[number][label] += 1
    names = {number: own.most_common(1)[0][0] for number, own in votes.items()}
    again = [pair for pair in _pairs(named[carried_at:], labels[carried_at:]) if pair[1] in names.values()]
    return sum(names.get(number) == label for number, label in again) / len(again) if again else None


def _pairs(named: Names, labels: Names) -> list[tuple[int, int]]:
    """Object, negative where it is taken for none, and label of every detection that is of something."""
    frames = zip(named, labels, strict=False)
    return [(number, label) for own, true in frames for number, label in zip(own, true, strict=True) if label >= 0]
