"""Ways in which a detector may be set, one for all objects: which is right is told by the evidence of all of them."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.log_space import log_sum_exp


@dataclass(frozen=True, kw_only=True)
class LabelSettings:
    """R ways that the detector may have."""

    repeat_shares: Array  # (R,) rho from the same place
    repeat_rads: Array  # (R,) turn, or change of the logarithm of the distance, after which rho is 1 / e of that
    by_score: Array  # (R,) 1 where scores count besides the word, else 0
    count_factors: Array  # (R,) on the Dirichlet counts of each class before any view
    other_factors: Array  # (R,) on those of what none of the labels means
    log_weights: Array  # (R,) before the first view, of which the exponentials sum to 1

    def __len__(self) -> int:
        return len(self.log_weights)

    @classmethod
    def grid(
        cls,
        repeat_shares: Sequence[float],
        repeat_rads: Sequence[float],
        count_factors: Sequence[float],
        other_factor: float | None = None,
    ) -> Self:
        """Every combination, all as likely; ``other_factor`` None: what none of the labels means is as the classes."""
        every = itertools.product(count_factors, (0.0, 1.0), repeat_shares, repeat_rads)
        factors, by_score, shares, rads = np.array(list(every)).T
        return cls(
            repeat_shares=shares,
            repeat_rads=rads,
            by_score=by_score,
            count_factors=factors,
            other_factors=factors if other_factor is None else np.full(len(factors), other_factor),
            log_weights=np.full(len(factors), -np.log(len(factors))),
        )

    def weighted(self, log_weights: Array) -> Self:
        """With other (R,) weights, up to a factor."""
        return replace(self, log_weights=log_weights - log_sum_exp(log_weights))

    def take(self, rows: Index) -> Self:
        """Some of them, as likely to each other as before."""
        kept = type(self)(**{item.name: getattr(self, item.name)[rows] for item in fields(self)})
        return kept.weighted(kept.log_weights)
