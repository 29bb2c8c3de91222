"""Probabilities ("shares") of alternative past associations that pruning removed from the live histories.

Pruning and merging resolve local ambiguities (which of two twins was it?) long before any evidence does, and all
histories that are left give the same answer. If a pruned history has its robot where that of a survivor is, both would
have continued alike: their differences are an alternative to the survivor's history, with a probability given by the
ratio of their weights. Alternatives are treated as independent of each other, and later evidence does not change their
probabilities.
"""

from dataclasses import dataclass, field

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.alternatives.differences import Change

LEAST_SHARE = 0.01
"""Alternatives whose probability is smaller in every history are forgotten."""


@dataclass
class Shares:
    """Probabilities of R alternatives in the H live hypotheses."""

    changes: list[tuple[Change, ...]] = field(default_factory=list)  # R, what each changes in a hypothesis's history
    values: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (R, H) probability that it is true instead

    def __post_init__(self) -> None:
        self._rows = {changes: row for row, changes in enumerate(self.changes)}

    def of_children(self, parents: Index) -> "Shares":
        """The alternatives inherited by H' children, from the indices ``parents`` (H',) of their parents."""
        return Shares(list(self.changes), self.values[:, parents])

    def give_up(self, share: float, changes: tuple[Change, ...], its: Array, heir: int) -> None:
        """Record a pruned history as an alternative to the hypothesis at ``heir``.

        ``share`` is its part of the weight of both; ``changes`` turn the heir's history into it. ``its`` (R',) are its
        own probabilities of the first R' alternatives.
        """
        own = self.values[:, heir]
        own *= 1.0 - share
        own[: len(its)] += share * its
        if changes:
            row = self._row(changes)
            self.values[row, heir] += share

    def likely(self) -> Flags:
        """(R,) which alternatives are likely enough in some history to be remembered."""
        return np.asarray(self.values.max(axis=1, initial=0.0) >= LEAST_SHARE)

    def take(self, rows: Index) -> "Shares":
        """Some of the alternatives."""
        return Shares([self.changes[row] for row in rows], self.values[rows])

    def _row(self, changes: tuple[Change, ...]) -> int:
        if changes not in self._rows:
            self._rows[changes] = len(self.changes)
            self.changes.append(changes)
            self.values = np.concatenate([self.values, np.zeros((1, self.values.shape[1]))])
        return self._rows[changes]
