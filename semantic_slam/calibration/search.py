"""The search for the configuration under which a drive is likeliest: coordinate steps, by factors of two."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from semantic_slam.calibration.posterior import refinements
from semantic_slam.calibration.quantities import Quantity, value_of, with_values
from semantic_slam.calibration.trial import Weighed, forget
from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError

LEAST_GAIN = 3.0
"""Nats by which a candidate must be better to be preferred: twenty to one."""
PASSES = 2
"""Over all quantities; the second asks again those that others have moved since."""
MOST_STEPS = 5
"""Factors of two away from where the search begins."""

Weigh = Callable[[Sequence[Configuration]], list[Weighed]]
"""Runs the drive under each of some configurations."""


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One candidate, against the best one before it."""

    quantity: str
    values: Mapping[str, Any]  # dotted name -> value, of what differs from that one
    log_evidence: float
    gain: float  # nats
    is_kept: bool = False
    fault: str = ""  # why it could not be compared


@dataclass(frozen=True)
class Change:
    """One parameter that calibration has changed."""

    before: Any
    after: Any
    quantity: str  # with which it was changed
    gain: float  # nats, of that quantity


@dataclass
class Search:
    """Moves from ``best``, the configuration to begin with, whose run gave ``outcome``, to better ones."""

    weigh: Weigh
    best: Configuration
    outcome: Weighed
    trials: list[Trial] = field(default_factory=list)
    changes: dict[str, Change] = field(default_factory=dict)  # by dotted name

    def __post_init__(self) -> None:
        self._start, self._first = self.best, self.outcome
        self._known: dict[Configuration, Weighed] = {self.best: self.outcome}

    def climb(self, quantities: Sequence[Quantity]) -> None:
        """Steps of each quantity in turn, as long as they raise the evidence."""
        steps = {item.name: 0 for item in quantities}
        for _ in range(PASSES):
            before = dict(steps)
            for item in quantities:
                steps[item.name] = self._climbed(item, steps[item.name])
            if steps == before:
                return

    def _climbed(self, item: Quantity, steps: int) -> int:
        """Steps of one quantity from the start of the search that are best."""
        up = self._best_of(item.name, [item.stepped(self.best, direction) for direction in (1, -1)])
        if up is None:
            return steps
        direction, steps = (1, -1)[up], steps + (1, -1)[up]
        while abs(steps) < MOST_STEPS and self._best_of(item.name, [item.stepped(self.best, direction)]) is not None:
            steps += direction
        return steps

    def refine(self) -> None:
        """Take over what the best run has inferred, where that raises the evidence."""
        for name in refinements(self.best, self.outcome.noise):
            self._best_of(name, [refinements(self.best, self.outcome.noise)[name]])

    def _best_of(self, quantity: str, changes: Sequence[Mapping[str, Any]]) -> int | None:
        """Which of some changes is best, and is kept; None: none is better enough."""
        candidates = [self._changed(values) for values in changes]
        is_new = [item not in self._known for item in candidates]
        self._weigh([item for item in candidates if isinstance(item, Configuration)])
        outcomes = [self._outcome(item) for item in candidates]
        gains = [outcome.log_evidence - self.outcome.log_evidence for outcome in outcomes]
        best = int(np.argmax(gains))
        found = best if gains[best] >= LEAST_GAIN else None
        self.trials += [
            Trial(
                quantity=quantity,
                values=changes[row],
                log_evidence=outcome.log_evidence,
                gain=gains[row],
                is_kept=row == found,
                fault=outcome.fault,
            )
            for row, outcome in enumerate(outcomes)
            if is_new[row]
        ]
        if found is not None:
            self._keep(quantity, changes[found], gains[found])
        self._forget_all_but_best(outcomes)
        return found

    def _forget_all_but_best(self, outcomes: Sequence[Weighed]) -> None:
        """Remove the beliefs of those that lost; those of the first run are kept, too."""
        for outcome in outcomes:
            if outcome.belief_bag not in (self._first.belief_bag, self.outcome.belief_bag):
                forget(outcome)

    def _changed(self, values: Mapping[str, Any]) -> Configuration | str:
        """The best configuration with other values, or why it cannot have them."""
        try:
            return with_values(self.best, values)
        except InputError as fault:
            return str(fault)

    def _weigh(self, candidates: Sequence[Configuration]) -> None:
        new = [item for item in dict.fromkeys(candidates) if item not in self._known]
        for item, outcome in zip(new, self.weigh(new) if new else [], strict=True):
            self._known[item] = outcome.beside(self._first)

    def _outcome(self, candidate: Configuration | str) -> Weighed:
        if isinstance(candidate, Configuration):
            return self._known[candidate]
        return Weighed(-np.inf, self.outcome.belief_bag, fault=candidate)

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
