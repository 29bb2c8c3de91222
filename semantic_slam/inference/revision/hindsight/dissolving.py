"""Histories in space in which objects of a live one are none, and which of them were tried."""

from semantic_slam.inference.revision.hindsight.dissolved import Dissolved, dissolved, lineage_of, without_all
from semantic_slam.inference.revision.hindsight.hindsight import Hindsight
from semantic_slam.inference.revision.hindsight.spatial import SpatialHindsight
from semantic_slam.inference.revision.replay import Lineage, Replay, Revised
from semantic_slam.inference.world.objects import ObjectRegistry

MORE = 2.0
"""Times that as many nats must speak against an object as when it was tried, for it to be tried again."""
LEAST_GAIN = 5.0
"""Nats that are to be gained roughly for a replay."""


class Dissolving:
    """Looks for likelier histories without objects that may be none."""

    def __init__(self, most: int, replay: Replay, registry: ObjectRegistry) -> None:
        """With at most so many histories in one look."""
        self._most, self._replay, self._registry = most, replay, registry
        self._tried: dict[int, float] = {}  # object -> what was to be gained without it
        self._proposed: dict[Lineage, tuple[int, float]] = {}  # without one object -> that, and what is to be gained

    def histories(self, followed: Revised) -> list[Lineage]:
        """Without all objects that may be none first, where there are several, and then without one of them."""
        view = SpatialHindsight.of(self._replay, self._registry, followed)
        found = [own for own in dissolved(view) if own.gain > LEAST_GAIN and self._is_news(view, own)]
        self._proposed = {lineage_of(view, own.owners): (int(view.ids[own.row]), own.gain) for own in found}
        together = [lineage_of(view, without_all(view, found))] if len(found) > 1 else []
        return [*together, *self._proposed][: self._most]

    def note(self, history: Lineage) -> None:
        """Remember that a history was replayed in vain."""
        if history in self._proposed:
            number, gain = self._proposed[history]
            self._tried[number] = gain

    def _is_news(self, view: Hindsight, own: Dissolved) -> bool:
        before = self._tried.get(int(view.ids[own.row]))
        return before is None or own.gain > MORE * before
