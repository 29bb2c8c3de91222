"""Proposals in space: histories without spurious objects, or with duplicates joined, and a memory of those tried."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from typing import NamedTuple

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.revision.hindsight.dissolved import dissolved, lineage_of
from semantic_slam.inference.revision.hindsight.hindsight import Hindsight
from semantic_slam.inference.revision.hindsight.joined import joined
from semantic_slam.inference.revision.hindsight.reassigned import reassigned
from semantic_slam.inference.revision.hindsight.spatial import SpatialHindsight
from semantic_slam.inference.revision.pairs import Pair, merged
from semantic_slam.inference.revision.replay import Replay, Revised
from semantic_slam.inference.states.lineage import Lineage
from semantic_slam.inference.world.objects import ObjectRegistry

MORE = 2.0
"""Growth factor of the gain at which a proposal that was tried is tried again."""
LEAST_GAIN = 5.0
"""Rough log gain [nats] that a replay requires."""
MOST_JOINS = 2
"""Groups of joined duplicates in one look, after objects that may be none: these pair with whatever is near."""

Change = tuple[tuple[int, ...], ...]
"""Groups of objects that become one each; of one alone: the object that is left out."""


class Proposal(NamedTuple):
    """A history that may be likelier."""

    change: Change
    gains: Array  # (T,) rough log gain of each keyframe
    history: Lineage


class Proposals:
    """Looks for likelier histories, with a memory of what was proposed in vain."""

    def __init__(self, most: int, replay: Replay, registry: ObjectRegistry) -> None:
        """``most``: largest number of histories without spurious objects in one look."""
        self._most, self._replay, self._registry = most, replay, registry
        self._tried: dict[Change, float] = {}  # rough gain when that was tried
        self._proposed: dict[Lineage, tuple[Change, float]] = {}  # history -> what it changes, and rough gain

    def histories(self, followed: Revised, pairs: Sequence[Pair] = ()) -> dict[Lineage, Array]:
        """Likelier histories, with their rough log gains (T,) of each keyframe.

        Objects that may be none are left out, and ``pairs`` of objects that may be one are joined.
        """
        view = SpatialHindsight.of(self._replay, self._registry, followed)
        self._proposed.clear()
        gains: dict[Lineage, Array] = {}
        without, joins = self._news(_without_suspects(view)), self._news(_with_joins(view, pairs))
        for change, own, history in [*islice(without, self._most), *islice(joins, MOST_JOINS)]:
            self._proposed.setdefault(history, (change, float(own.sum())))
            gains.setdefault(history, own)
        return gains

    def _news(self, proposals: Iterable[Proposal]) -> Iterator[Proposal]:
        """Proposals that promise enough, and enough more than when they were tried in vain."""
        for proposal in proposals:
            if proposal.gains.sum() > max(LEAST_GAIN, MORE * self._tried.get(proposal.change, 0.0)):
                yield proposal

    def note(self, history: Lineage) -> None:
        """Record that a history was replayed and not accepted."""
        if history in self._proposed:
            change, gain = self._proposed[history]
            self._tried[change] = gain


def _without_suspects(view: Hindsight) -> Iterator[Proposal]:
    """Without all suspects and with all frames reassigned, and without one each."""
    suspects = [own for own in dissolved(view) if own.gain > LEAST_GAIN]
    rows = sorted(own.row for own in suspects)
    whole, numbers = reassigned(view, rows), [(number,) for number in view.ids[rows].tolist()]
    yield Proposal(tuple(numbers), whole.gains, lineage_of(view, whole.owners))
    for own in suspects:
        yield Proposal(((int(view.ids[own.row]),),), own.gains, lineage_of(view, own.owners))


def _with_joins(view: Hindsight, pairs: Sequence[Pair]) -> Iterator[Proposal]:
    """With groups of pairs joined, likeliest first; a pair of one group is in no other one."""
    taken = set[Pair]()
    for own in joined(view, pairs, LEAST_GAIN):
        if taken.isdisjoint(own.pairs):
            taken.update(own.pairs)
            yield Proposal(own.pairs, own.gains, merged(view.lineage, own.pairs))
