"""What the histories that are followed leave out, as shares of them: alternatives to stretches of a history.

Local questions, which of two twins was that, are answered by pruning and merging long before anything tells, and the
histories that are left all give the same answer. Where a history is given up and one is followed whose robot stands
where its own does, the two would have gone on alike: in what they differ is an alternative to the one that stays, and
its share is that of their weights. Alternatives count as independent of each other, and later evidence leaves shares
alone.
"""

from dataclasses import dataclass, field

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.alternatives.differences import Change

LEAST_SHARE = 0.01
"""Alternatives of a smaller share, in every history, are forgotten."""


@dataclass
class Shares:
    """R alternatives and the H hypotheses that are followed."""

    changes: list[tuple[Change, ...]] = field(default_factory=list)  # R, each to the history that has it
    values: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (R, H) probability that it was so instead

    def __post_init__(self) -> None:
        self._rows = {changes: row for row, changes in enumerate(self.changes)}

    def of_children(self, parents: Index) -> "Shares":
        """Alternatives of hypotheses that grew from these: (H',) of which each did."""
        return Shares(list(self.changes), self.values[:, parents])

    def give_up(self, share: float, changes: tuple[Change, ...], its: Array, heir: int) -> None:
        """A history goes up in the hypothesis at ``heir``, as a ``share`` of both; ``changes`` to that one make it.

        ``its`` (R',) are its own shares of the R' alternatives that were known first.
        """
        own = self.values[:, heir]
        own *= 1.0 - share
        own[: len(its)] += share * its
        if changes:
            row = self._row(changes)
            self.values[row, heir] += share

    def likely(self) -> Flags:
        """(R,) which alternatives are likely enough in some history."""
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
