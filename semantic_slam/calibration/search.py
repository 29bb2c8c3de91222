"""Coordinate search for the configuration with the highest evidence, in steps by factors of two."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from semantic_slam.calibration.posterior import refinements
from semantic_slam.calibration.quantities import Quantity, value_of, with_values
from semantic_slam.calibration.trial import Weighed, forget
from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError

LEAST_GAIN = 5.0
"""Smallest gain [nats] at which a candidate is preferred: odds of 20:1 after correcting for eight trials."""
ROUNDS = 4
"""Largest number of quantities stepped, one after the other."""
MOST_STEPS = 5
"""Largest number of steps (factors of two) from the start of the search."""

Weigh = Callable[[Sequence[Configuration]], list[Weighed]]
"""Function that runs the drive under each of several configurations."""


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One candidate, compared with the best one before it."""

    quantity: str
    values: Mapping[str, Any]  # dotted name -> value, where it differs from the best
    log_evidence: float
    gain: float  # nats
    is_kept: bool = False
    fault: str = ""  # why it could not be compared


@dataclass(frozen=True)
class Change:
    """One parameter changed by calibration."""

    before: Any
    after: Any
    quantity: str  # with which it was changed
    gain: float  # nats, of that quantity


@dataclass
class Search:
    """Search state: ``best`` configuration so far, with its ``outcome``; starts from the initial configuration."""

    weigh: Weigh
    best: Configuration
    outcome: Weighed
    trials: list[Trial] = field(default_factory=list)
    changes: dict[str, Change] = field(default_factory=dict)  # by dotted name

    def __post_init__(self) -> None:
        self._start, self._first = self.best, self.outcome
        self._known: dict[Configuration | str, Weighed] = {self.best: self.outcome}  # a string says why it is invalid

    def climb(self, quantities: Sequence[Quantity]) -> None:
        """Coordinate ascent: step the steepest quantity as long as the evidence rises, then choose the next."""
        steps = {item.name: 0 for item in quantities}
        for _ in range(ROUNDS):
            ways = [(own, way) for own in quantities for way in (1, -1) if abs(steps[own.name] + way) <= MOST_STEPS]
            chosen = self._best_of([(item.name, item.stepped(self.best, way)) for item, way in ways])
            if chosen is None:
                return
            item, way = ways[chosen]
            steps[item.name] += way
            while abs(steps[item.name]) < MOST_STEPS:
                if self._best_of([(item.name, item.stepped(self.best, way))]) is None:
                    break
                steps[item.name] += way

    def refine(self) -> None:
        """Adopt noise values inferred by the best run, where that raises the evidence."""
        for name in refinements(self.best, self.outcome.noise):
            self._best_of([(name, refinements(self.best, self.outcome.noise)[name])])

    def _best_of(self, changes: Sequence[tuple[str, Mapping[str, Any]]]) -> int | None:
        """Index of the best of several changes, which is kept; None where none gains enough."""
        candidates = [self._changed(values) for _, values in changes]
        is_new = [item not in self._known for item in candidates]
        self._weigh(candidates)
        outcomes = [self._known[item] for item in candidates]
        gains = [outcome.log_evidence - self.outcome.log_evidence for outcome in outcomes]
        best = int(np.argmax(gains))
        found = best if gains[best] >= LEAST_GAIN else None
        self.trials += [
            Trial(
                quantity=changes[row][0],
                values=changes[row][1],
                log_evidence=outcome.log_evidence,
                gain=gains[row],
                is_kept=row == found,
                fault=outcome.fault,
            )
            for row, outcome in enumerate(outcomes)
            if is_new[row]
        ]
        if found is not None:
            self._keep(*changes[found], gains[found])
        self._forget_all_but_best(outcomes)
        return found

    def _forget_all_but_best(self, outcomes: Sequence[Weighed]) -> None:
        """Delete the beliefs of all runs but the best and the first."""
        for outcome in outcomes:
            if outcome.belief_bag not in (self._first.belief_bag, self.outcome.belief_bag):
                forget(outcome)

    def _changed(self, values: Mapping[str, Any]) -> Configuration | str:
        """Best configuration with changed values, or the reason why they are invalid."""
        try:
            return with_values(self.best, values)
        except InputError as fault:
            return str(fault)

    def _weigh(self, candidates: Sequence[Configuration | str]) -> None:
        unknown = [item for item in dict.fromkeys(candidates) if item not in self._known]
        new = [item for item in unknown if isinstance(item, Configuration)]
        for item, outcome in zip(new, self.weigh(new) if new else [], strict=True):
            self._known[item] = outcome.beside(self._first)
        for fault in unknown:
            if isinstance(fault, str):
                self._known[fault] = Weighed(-np.inf, self.outcome.belief_bag, fault=fault)

    def _keep(self, quantity: str, values: Mapping[str, Any], gain: float) -> None:
        left = self.outcome
        self.best = with_values(self.best, values)
        self.outcome = self._known[self.best]
        self._forget_all_but_best([left])
        gained = gain + next((own.gain for own in self.changes.values() if own.quantity == quantity), 0.0)
        touched = dict.fromkeys([*(n for n, own in self.changes.items() if own.quantity == quantity), *values])
        for name in touched:
            before, after = value_of(self._start, name), value_of(self.best, name)
            self.changes.pop(name, None)
            if before != after:
                self.changes[name] = Change(before, after, quantity, gained)
