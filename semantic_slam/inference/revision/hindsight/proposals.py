"""Proposals in space: histories without spurious objects, or with duplicates joined, and a memory of those tried."""

from collections.abc import Iterator, Sequence
from itertools import islice
from typing import NamedTuple

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.revision.hindsight.dissolved import dissolved, lineage_of
from semantic_slam.inference.revision.hindsight.hindsight import Hindsight
from semantic_slam.inference.revision.hindsight.joined import joined
from semantic_slam.inference.revision.hindsight.parted import parted
from semantic_slam.inference.revision.hindsight.reassigned import reassigned
from semantic_slam.inference.revision.hindsight.spatial import SpatialHindsight
from semantic_slam.inference.revision.pairs import Pair
from semantic_slam.inference.revision.replay import Replay, Revised
from semantic_slam.inference.states.lineage import Lineage
from semantic_slam.inference.world.objects import ObjectRegistry

MORE = 2.0
"""Growth factor of the gain at which a proposal that was tried is tried again."""
LEAST_GAIN = 5.0
"""Rough log gain [nats] that a replay requires."""

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
        """``most``: largest number of histories in one look."""
        self._most, self._replay, self._registry = most, replay, registry
        self._tried: dict[Change, float] = {}  # rough gain when that was tried
        self._proposed: dict[Lineage, tuple[Change, float]] = {}  # history -> what it changes, and rough gain

    def histories(self, followed: Revised, pairs: Sequence[Pair] = ()) -> dict[Lineage, Array]:
        """Likelier histories, with their rough log gains (T,) of each keyframe.

        The one with all frames reassigned without the suspects comes first, then those without one each, or with
        ``pairs`` of objects joined, by gain.
        """
        view = SpatialHindsight.of(self._replay, self._registry, followed)
        self._proposed.clear()
        gains: dict[Lineage, Array] = {}
        for change, own, history in self._candidates(view, pairs):
            gain = float(own.sum())
            if gain > LEAST_GAIN and gain > MORE * self._tried.get(change, 0.0):
                self._proposed.setdefault(history, (change, gain))
                gains.setdefault(history, own)
        return dict(islice(gains.items(), self._most))

    def note(self, history: Lineage) -> None:
        """Record that a history was replayed and not accepted."""
        if history in self._proposed:
            change, gain = self._proposed[history]
            self._tried[change] = gain

    def _candidates(self, view: Hindsight, pairs: Sequence[Pair]) -> Iterator[Proposal]:
        suspects = [own for own in dissolved(view) if own.gain > LEAST_GAIN]
        rows = sorted(own.row for own in suspects)
        whole = reassigned(view, rows)
        yield Proposal(tuple((number,) for number in view.ids[rows].tolist()), whole.gains, lineage_of(view, whole.owners))
        every = [Proposal(((int(view.ids[own.row]),),), own.gains, lineage_of(view, own.owners)) for own in suspects]
        merges = joined(view, pairs, LEAST_GAIN)
        every += [Proposal(tuple(own.pairs), own.gains, own.history(view)) for own in merges]
        every += [Proposal(((own.object_id, own.first),), own.gains, own.history(view)) for own in parted(view, LEAST_GAIN)]
        yield from sorted(every, key=lambda own: -own.gains.sum())
