"""Discrete hyperparameter settings of a detector, shared by all objects and inferred from their evidence."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.log_space import log_sum_exp


@dataclass(frozen=True, kw_only=True)
class LabelSettings:
    """R hyperparameter settings with their prior weights."""

    repeat_shares: Array  # (R,) rho at the same viewpoint
    repeat_rads: Array  # (R,) angle, or change of log distance, over which rho decays by 1 / e
    score_powers: Array  # (R,) power of the scores that is a probability; 0: the word alone counts
    count_factors: Array  # (R,) multipliers of the prior Dirichlet counts of the classes
    other_factors: Array  # (R,) multipliers of those of the class "none of the labels"
    log_weights: Array  # (R,) normalised log prior

    def __len__(self) -> int:
        return len(self.log_weights)

    @classmethod
    def grid(
        cls,
        repeat_shares: Sequence[float],
        repeat_rads: Sequence[float],
        count_factors: Sequence[float],
        other_factor: float | None = None,
        score_powers: Sequence[float] = (0.0, 1.0),
    ) -> Self:
        """All combinations, equally likely; ``other_factor`` None: "none of the labels" has the classes' factor."""
        every = itertools.product(count_factors, score_powers, repeat_shares, repeat_rads)
        factors, powers, shares, rads = np.array(list(every)).T
        return cls(
            repeat_shares=shares,
            repeat_rads=rads,
            score_powers=powers,
            count_factors=factors,
            other_factors=factors if other_factor is None else np.full(len(factors), other_factor),
            log_weights=np.full(len(factors), -np.log(len(factors))),
        )

    def weighted(self, log_weights: Array) -> Self:
        """Settings with other (R,) log weights, which are normalised here."""
        return replace(self, log_weights=log_weights - log_sum_exp(log_weights))

    def with_powers(self, powers: Sequence[float]) -> Self:
        """All different settings but for the power of scores, each with every one of these, equally likely."""
        rest = [item.name for item in fields(self) if item.name not in ("score_powers", "log_weights")]
        kinds = np.unique(np.stack([getattr(self, name) for name in rest]), axis=1)  # (., K)
        values = dict(zip(rest, np.repeat(kinds, len(powers), axis=1), strict=True))
        count = kinds.shape[1] * len(powers)
        return type(self)(
            score_powers=np.tile(powers, kinds.shape[1]), log_weights=np.full(count, -np.log(count)), **values
        )

    def take(self, rows: Index) -> Self:
        """A subset of the settings, with renormalised weights."""
        kept = type(self)(**{item.name: getattr(self, item.name)[rows] for item in fields(self)})
        return kept.weighted(kept.log_weights)
