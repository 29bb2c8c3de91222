"""Posterior probability that mapped objects were displaced since the map was made, from one component's estimates.

A priori an object is where the map has it, N(m, P), with probability 1 - e, and was moved, N(m, P + s^2 I), with e.
A component assumes one alternative for each object, N(m, A), and not the other, N(m, B); its posterior is N(mu, S).
If its assumption is wrong for a set D of objects, the evidence is that of the component times

    E[prod_{i in D} N(x_i; m_i, B_i) / N(x_i; m_i, A_i)],  x ~ N(mu, S),

which has a closed form: with C = A^-1 - B^-1 and d = mu - m it is
|A|^1/2 |B|^-1/2 |I - C S|^-1/2 exp(d^T (I - C S)^-1 C d / 2), blocks being those of D.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from scipy.special import logsumexp

from semantic_slam.geometry.arrays import Array, Flags, Index

AROUND = 2
"""Largest number of objects in which the summed sets differ from the likeliest one.

If the likeliest set has two objects, these are sets of up to four.
"""


@dataclass(frozen=True, kw_only=True)
class Displacement:
    """Positions (d components) of n mapped objects: a component's posterior, the map's prior, what it assumes moved."""

    offset: Array  # (n, d) posterior mean minus the map's mean, metres
    covariance: Array  # (n d, n d) posterior
    prior: Array  # (n, d, d) the map's covariances of objects that were not moved
    taken: Flags  # (n,) objects that the component assumes to have been moved
    share: float  # e
    sigma_m: float  # s

    def probabilities(self) -> Array:
        """(n,) probabilities that each was moved, given the component's associations."""
        sets = list(self._around(self._likeliest()))
        logs = self._log_odds(sets)
        weights = np.exp(logs - logsumexp(logs))
        wrongly = np.array([weights[[i in wrong for wrong in sets]].sum() for i in range(len(self.offset))])
        return np.where(self.taken, 1.0 - wrongly, wrongly)

    def _likeliest(self) -> frozenset[int]:
        """The likeliest set D by greedy search from the empty set: change the best object, until none gains."""
        chosen, best = frozenset[int](), 0.0
        while True:
            changed = [chosen ^ {i} for i in range(len(self.offset))]
            logs = self._log_odds(changed)
            if logs.max(initial=-np.inf) <= best:
                return chosen
            chosen, best = changed[int(np.argmax(logs))], float(logs.max())

    def _around(self, centre: frozenset[int]) -> Iterable[frozenset[int]]:
        for size in range(AROUND + 1):
            for changed in combinations(range(len(self.offset)), size):
                yield centre ^ set(changed)

    def _log_odds(self, sets: Sequence[frozenset[int]]) -> Array:
        """Log posterior odds, in nats, that the assumption is wrong for exactly each set, against for no object."""
        logs, sizes = np.zeros(len(sets)), np.array([len(wrong) for wrong in sets])
        for size in np.unique(sizes[sizes > 0]):
            alike = np.flatnonzero(sizes == size)
            logs[alike] = self._log_odds_of(np.array([sorted(sets[int(i)]) for i in alike]))
        return logs

    def _log_odds_of(self, wrong: Index) -> Array:
        """(N,) log posterior odds of N sets of k objects each, (N, k)."""
        (count, objects), size = wrong.shape, self.offset.shape[1]
        places = (size * wrong[:, :, None] + np.arange(size)).reshape(count, -1)
        blocks, each = np.zeros((count, objects, size, objects, size)), np.arange(objects)
        precisions, log_volumes = self._change
        blocks[:, each, :, each, :] = np.swapaxes(precisions[wrong], 0, 1)
        change = blocks.reshape(count, objects * size, -1)
        left = np.eye(objects * size) - change @ self.covariance[places[:, :, None], places[:, None, :]]
        offset = self.offset[wrong].reshape(count, -1, 1)
        gain = (offset * np.linalg.solve(left, change @ offset)).sum(axis=(1, 2))
        volume = log_volumes[wrong].sum(axis=1) - np.linalg.slogdet(left)[1]
        odds = np.where(self.taken, -1.0, 1.0)[wrong].sum(axis=1) * np.log(self.share / (1.0 - self.share))
        return np.asarray(odds + 0.5 * (volume + gain))

    @cached_property
    def _change(self) -> tuple[Array, Array]:
        """C (n, d, d) and log |A| - log |B| (n,) of each object by itself."""
        wide, taken = self.prior + self.sigma_m**2 * np.eye(self.offset.shape[1]), self.taken[:, None, None]
        own, other = np.where(taken, wide, self.prior), np.where(taken, self.prior, wide)
        return np.linalg.inv(own) - np.linalg.inv(other), np.linalg.slogdet(own)[1] - np.linalg.slogdet(other)[1]
