"""Histories in space in which objects of a live one are none, the first that is likelier, and which were tried."""

from collections.abc import Sequence

from semantic_slam.inference.revision.dissolved import Dissolved, Owners, dissolved, lineage_of, without_all
from semantic_slam.inference.revision.hindsight import Hindsight
from semantic_slam.inference.revision.replay import Lineage, Replay, Revised
from semantic_slam.inference.revision.spatial_hindsight import SpatialHindsight
from semantic_slam.inference.world.objects import ObjectRegistry

MORE = 2.0
"""Times that as many nats must speak against an object as when it was tried, for it to be tried again."""
LEAST_GAIN = 5.0
"""Nats that are to be gained roughly for a replay."""

Trial = tuple[Sequence[Dissolved], Owners]
"""Objects that may be none, and what their detections are of without them."""


class Dissolving:
    """Looks for likelier histories without objects that may be none."""

    def __init__(self, most: int, replay: Replay, registry: ObjectRegistry) -> None:
        """With at most so many replays in one look."""
        self._most, self._replay, self._registry = most, replay, registry
        self._tried: dict[int, float] = {}  # object -> what was to be gained without it

    def history(self, followed: Revised) -> Lineage | None:
        """Without all objects that may be none, or else without one of them; None where no history is likelier."""
        view = SpatialHindsight.of(self._replay, self._registry, followed)
        found = [own for own in dissolved(view) if own.gain > LEAST_GAIN and self._is_news(view, own)]
        trials = [(found, without_all(view, found))] if len(found) > 1 else []
        trials += [([own], own.owners) for own in found]
        return self._first_likelier(view, followed, trials[: self._most])

    def _first_likelier(self, view: Hindsight, followed: Revised, trials: Sequence[Trial]) -> Lineage | None:
        for gone, owners in trials:
            _, own = self._replay.log_joints([followed.lineage, lineage_of(view, owners)])
            if own is not None and own.log_joint > followed.log_joint:
                return own.lineage
            if len(gone) == 1:
                self._tried[int(view.ids[gone[0].row])] = gone[0].gain
        return None

    def _is_news(self, view: Hindsight, own: Dissolved) -> bool:
        before = self._tried.get(int(view.ids[own.row]))
        return before is None or own.gain > MORE * before
