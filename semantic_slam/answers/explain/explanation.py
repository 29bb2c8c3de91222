"""``explain``: the evidence in a recorded run for its belief about one object."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from semantic_slam.answers.explain.ledger import ClassLedger, PairLedger, class_ledger, histories
from semantic_slam.answers.explain.outlier_views import OutlierViews
from semantic_slam.answers.explain.replayed_run import ReplayedRun, replay
from semantic_slam.answers.explain.rivals import Rival, rivals
from semantic_slam.answers.explain.sightings import Sighting, object_name, sightings
from semantic_slam.answers.rows import row_named
from semantic_slam.configuration import from_dict
from semantic_slam.errors import InputError
from semantic_slam.evaluation.belief_bag import belief_bag, read_record
from semantic_slam.evaluation.record import Record, json_object
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.pipeline.recorded_keyframes import recorded_keyframes


@dataclass(frozen=True, kw_only=True)
class HistoryExplained:
    """One association history of the last belief, and its account of the object."""

    ledger: ClassLedger
    weight: float
    pair: PairLedger | None  # None: there are no class models
    views: tuple[Sighting, ...]
    rivals: tuple[Rival, ...]


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """Belief about an object and its explanation; histories sorted by weight, heaviest first."""

    object_id: int
    name: str
    belief: HybridBelief  # the last one
    classes: tuple[int, int] | None  # the two compared classes, the likelier first unless given by the user
    histories: tuple[HistoryExplained, ...]
    run: ReplayedRun

    @property
    def row(self) -> int:
        """Row of the object in the belief."""
        return int(np.flatnonzero(self.belief.object_ids == self.object_id)[0])

    def name_of(self, number: int) -> str:
        """Name of an object; objects that only pruned histories had are named by number."""
        if number < 0:
            return "no object"
        known = number in self.belief.object_ids
        return object_name(self.belief, number) if known else f"{number} (dropped)"

    def alone(self, history: HistoryExplained) -> Array:
        """(V,) log likelihood ratio [nats] of the two classes for each view alone; NaN without classes."""
        if self.classes is None:
            return np.full(len(history.views), np.nan)
        index = {keyframe.belief.keyframe: k for k, keyframe in enumerate(self.run.keyframes)}
        rows, (one, other) = [index[view.keyframe] for view in history.views], self.classes
        return np.asarray(history.ledger.alone[rows, one] - history.ledger.alone[rows, other])


def explain(path: str | Path, object_name: str, classes: tuple[str, str] | None = None) -> Explanation:
    """Explain the belief about an object in a belief bag or a report's folder. Raises InputError.

    ``object_name``: its name, or its number where none has that name. The run's inference is repeated.
    ``classes``: two to compare; None: the most likely one and its nearest rival.
    """
    bag = belief_bag(path)
    record = read_record(bag)
    last = record.beliefs[-1]
    object_id = int(last.object_ids[row_named(last, object_name)])
    chosen = None if classes is None else _classes(record.beliefs[-1], classes)
    return explanation_of(record, _replayed(bag, record, [object_id]), object_id, chosen)


def explanations(bag: Path, object_ids: Sequence[int]) -> list[Explanation]:
    """Explanations of several objects by the heaviest history, with a single replay of the bag. Raises InputError."""
    record = read_record(bag)
    run = _replayed(bag, record, object_ids)
    return [explanation_of(record, run, object_id, most=1) for object_id in object_ids]


def _replayed(bag: Path, record: Record, object_ids: Sequence[int]) -> ReplayedRun:
    configuration = from_dict(json_object(record.run.configuration), str(bag))
    return replay(record, recorded_keyframes(bag, configuration, len(record.beliefs)), object_ids)


def explanation_of(
    record: Record, run: ReplayedRun, object_id: int, classes: tuple[int, int] | None = None, most: int | None = None
) -> Explanation:
    """Explanation of an object from a run that was replayed with it watched; ``classes`` by number.

    ``most``: number of heaviest histories to include; None: all.
    """
    last = record.beliefs[-1]
    ledgers = [class_ledger(run, object_id, members) for members in histories(run)[:most]]
    if classes is None and last.class_names:
        classes = compared_classes(ledgers[0])
    configuration = from_dict(json_object(record.run.configuration), "run configuration")
    outliers, found = OutlierViews.of(configuration.semantic_model), []
    for ledger in ledgers:
        found.append(
            HistoryExplained(
                ledger=ledger,
                weight=float(np.exp(ledger.log_weight)),
                pair=None if classes is None else ledger.pair(*classes),
                views=sightings(run, ledger, record.measurements, outliers),
                rivals=rivals(run, ledger),
            )
        )
    row = int(np.flatnonzero(last.object_ids == object_id)[0])
    return Explanation(
        object_id=object_id,
        name=last.object_names[row],
        belief=last,
        classes=classes,
        histories=tuple(found),
        run=run,
    )


def compared_classes(ledger: ClassLedger) -> tuple[int, int]:
    """The most likely class and its nearest rival: the next likely one, or else the one pruned last."""
    best = int(np.argmax(ledger.log_posterior))
    others = [cls for cls in range(len(ledger.log_prior)) if cls != best]

    def nearness(cls: int) -> tuple[int, float, float]:
        pair = ledger.pair(best, cls)
        odds = pair.gone if pair.is_pruned else pair.log_odds
        return pair.until, -round(odds, 3), -float(np.nansum(ledger.alone[:, best] - ledger.alone[:, cls]))

    return best, max(others, key=nearness, default=best)


def _classes(belief: HybridBelief, names: tuple[str, str]) -> tuple[int, int]:
    """Indices of two class names. Raises InputError."""
    for name in names:
        if name not in belief.class_names:
            known = ", ".join(belief.class_names) or "none: its class models name no classes"
            raise InputError(f"'{name}' is no class of the map, which knows {known}; name two of these")
    if names[0] == names[1]:
        raise InputError(f"'{names[0]}' is compared with itself; name two classes")
    return belief.class_names.index(names[0]), belief.class_names.index(names[1])
