"""Proposals in space of histories without spurious objects, with a memory of those tried."""

from semantic_slam.inference.revision.hindsight.dissolved import Dissolved, dissolved, lineage_of, without_all
from semantic_slam.inference.revision.hindsight.hindsight import Hindsight
from semantic_slam.inference.revision.hindsight.spatial import SpatialHindsight
from semantic_slam.inference.revision.replay import Replay, Revised
from semantic_slam.inference.states.lineage import Lineage
from semantic_slam.inference.world.objects import ObjectRegistry

MORE = 2.0
"""Growth factor of the gain at which an object that was tried is tried again."""
LEAST_GAIN = 5.0
"""Rough log gain [nats] that a replay requires."""


class Dissolving:
    """Looks for likelier histories without spurious objects."""

    def __init__(self, most: int, replay: Replay, registry: ObjectRegistry) -> None:
        """``most``: largest number of histories in one look."""
        self._most, self._replay, self._registry = most, replay, registry
        self._tried: dict[int, float] = {}  # object -> rough gain when it was tried
        self._proposed: dict[Lineage, tuple[int, float]] = {}  # history -> object left out, and rough gain

    def histories(self, followed: Revised) -> list[Lineage]:
        """Histories without all suspects at once, if several, and then without one each."""
        view = SpatialHindsight.of(self._replay, self._registry, followed)
        found = [own for own in dissolved(view) if own.gain > LEAST_GAIN and self._is_news(view, own)]
        self._proposed = {lineage_of(view, own.owners): (int(view.ids[own.row]), own.gain) for own in found}
        together = [lineage_of(view, without_all(view, found))] if len(found) > 1 else []
        return [*together, *self._proposed][: self._most]

    def note(self, history: Lineage) -> None:
        """Record that a history was replayed and not accepted."""
        if history in self._proposed:
            number, gain = self._proposed[history]
            self._tried[number] = gain

    def _is_news(self, view: Hindsight, own: Dissolved) -> bool:
        before = self._tried.get(int(view.ids[own.row]))
        return before is None or own.gain > MORE * before
