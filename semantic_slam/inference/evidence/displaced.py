"""Posterior probability that mapped objects were displaced since the map was made, from one component's estimates.

A priori objects are where the map has them, N(m, P), and one that was moved is s off, P + s^2 I in its own block; P may
be a joint covariance, whose errors the objects have in common. A component assumes that some were moved, N(m, A), and
its posterior is N(mu, S). If its assumption is wrong for a set D of objects, so that their blocks of A change by
V = +-s^2 I, the evidence is that of the component times

    E[N(x; m, A + V) / N(x; m, A)],  x ~ N(mu, S),

which has a closed form: with y = A^-1 (mu - m) and H = A^-1 (A - S) A^-1, the score of what was seen and its variance
under the assumption, it is |I + V H|^-1/2 exp(y^T (V^-1 + H)^-1 y / 2), of y and H the rows of D alone.
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
    """Positions (d components) of n mapped objects: a component's posterior, its prior, what it assumes moved."""

    offset: Array  # (n, d) posterior mean minus the map's mean, metres
    covariance: Array  # (n d, n d) posterior
    prior: Array  # (n d, n d) that the component assumes; wide in the blocks of ``taken``
    taken: Flags  # (n,) objects that the component assumes to have been moved
    weighed: Index  # (m,) rows of the objects that are asked about; the others are as the component assumes
    share: float  # e, the prior probability that an object was moved
    sigma_m: float  # s

    def probabilities(self) -> Array:
        """(m,) probabilities that each was moved, given the component's associations."""
        sets = list(self._around(self._likeliest()))
        logs = self._log_odds(sets)
        weights = np.exp(logs - logsumexp(logs))
        wrongly = np.array([weights[[i in wrong for wrong in sets]].sum() for i in self.weighed])
        return np.where(self.taken[self.weighed], 1.0 - wrongly, wrongly)

    def _likeliest(self) -> frozenset[int]:
        """The likeliest set D by greedy search from the empty set: change the best object, until none gains."""
        chosen, best = frozenset[int](), 0.0
        while True:
            changed = [chosen ^ {int(i)} for i in self.weighed]
            logs = self._log_odds(changed)
            if logs.max(initial=-np.inf) <= best:
                return chosen
            chosen, best = changed[int(np.argmax(logs))], float(logs.max())

    def _around(self, centre: frozenset[int]) -> Iterable[frozenset[int]]:
        for size in range(AROUND + 1):
            for changed in combinations(self.weighed.tolist(), size):
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
        count, size = len(wrong), self.offset.shape[1]
        places = (size * wrong[:, :, None] + np.arange(size)).reshape(count, -1)
        taken = np.repeat(self.taken[wrong], size, axis=1)
        change = np.where(taken, -1.0, 1.0) * self.sigma_m**2
        score, seen = self._seen
        score, seen = score[places][..., None], seen[places[:, :, None], places[:, None, :]]
        each = np.eye(places.shape[1])
        volume = np.linalg.slogdet(each + change[:, :, None] * seen)[1]
        gain = (score * np.linalg.solve(each / change[:, None, :] + seen, score)).sum(axis=(1, 2))
        odds = np.where(self.taken, -1.0, 1.0)[wrong].sum(axis=1) * np.log(self.share / (1.0 - self.share))
        return np.asarray(odds + 0.5 * (gain - volume))

    @cached_property
    def _seen(self) -> tuple[Array, Array]:
        """(n d,) score of what was seen, and its (n d, n d) variance under what the component assumes.

        Estimates may be less certain than the prior by their approximations: they tell nothing then.
        """
        precision = np.linalg.inv(self.prior)
        variance = precision @ (self.prior - self.covariance) @ precision
        values, axes = np.linalg.eigh(0.5 * (variance + variance.T))
        return precision @ self.offset.ravel(), (axes * np.maximum(values, 0.0)) @ axes.T
