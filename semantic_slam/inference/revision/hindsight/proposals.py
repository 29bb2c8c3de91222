"""Proposals in space: histories without spurious objects, or with duplicates joined, and a memory of those tried."""

from collections.abc import Sequence
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

        Objects that may be none are left out, and ``pairs`` of objects that may be one are joined.
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

    def _candidates(self, view: Hindsight, pairs: Sequence[Pair]) -> list[Proposal]:
        """Without the suspects and with all frames reassigned; without one each; with pairs joined. By gain."""
        suspects = [own for own in dissolved(view) if own.gain > LEAST_GAIN]
        rows = sorted(own.row for own in suspects)
        whole, numbers = reassigned(view, rows), [(number,) for number in view.ids[rows].tolist()]
        found = [Proposal(tuple(numbers), whole.gains, lineage_of(view, whole.owners))]
        found += [Proposal(((int(view.ids[own.row]),),), own.gains, lineage_of(view, own.owners)) for own in suspects]
        merges = joined(view, pairs, LEAST_GAIN)
        found += [Proposal(own.pairs, own.gains, merged(view.lineage, own.pairs)) for own in merges]
        return sorted(found, key=lambda own: -own.gains.sum())
