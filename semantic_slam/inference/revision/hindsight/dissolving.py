"""Proposals in space of histories without spurious objects, with a memory of those tried."""

from collections.abc import Iterator
from itertools import islice

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.revision.hindsight.dissolved import Dissolved, dissolved, lineage_of
from semantic_slam.inference.revision.hindsight.hindsight import Hindsight
from semantic_slam.inference.revision.hindsight.reassigned import Reassigned, reassigned
from semantic_slam.inference.revision.hindsight.spatial import SpatialHindsight
from semantic_slam.inference.revision.replay import Replay, Revised
from semantic_slam.inference.revision.tried import Group
from semantic_slam.inference.states.lineage import Lineage
from semantic_slam.inference.world.objects import ObjectRegistry

MORE = 2.0
"""Growth factor of the gain at which a proposal that was tried is tried again."""
LEAST_GAIN = 5.0
"""Rough log gain [nats] that a replay requires."""


class Dissolving:
    """Looks for likelier histories without spurious objects."""

    def __init__(self, most: int, replay: Replay, registry: ObjectRegistry) -> None:
        """``most``: largest number of histories in one look."""
        self._most, self._replay, self._registry = most, replay, registry
        self._tried: dict[Group, float] = {}  # objects left out -> rough gain when that was tried
        self._proposed: dict[Lineage, tuple[Group, float]] = {}  # history -> objects left out, and rough gain

    def histories(self, followed: Revised) -> dict[Lineage, Array]:
        """The history with all frames reassigned without the suspects, and those without one each.

        With the rough log gains (T,) of each keyframe.
        """
        view = SpatialHindsight.of(self._replay, self._registry, followed)
        self._proposed.clear()
        gains: dict[Lineage, Array] = {}
        for objects, found in self._candidates(view):
            if found.gain > LEAST_GAIN and found.gain > MORE * self._tried.get(objects, 0.0):
                history = lineage_of(view, found.owners)
                self._proposed.setdefault(history, (objects, found.gain))
                gains.setdefault(history, found.gains)
        return dict(islice(gains.items(), self._most))

    def note(self, history: Lineage) -> None:
        """Record that a history was replayed and not accepted."""
        if history in self._proposed:
            objects, gain = self._proposed[history]
            self._tried[objects] = gain

    def _candidates(self, view: Hindsight) -> Iterator[tuple[Group, Reassigned | Dissolved]]:
        """Objects left out, with the history without them."""
        suspects = [own for own in dissolved(view) if own.gain > LEAST_GAIN]
        rows = sorted(own.row for own in suspects)
        yield tuple(view.ids[rows].tolist()), reassigned(view, rows)
        for own in suspects:
            yield (int(view.ids[own.row]),), own
