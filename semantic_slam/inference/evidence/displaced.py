"""Which objects of a map stand elsewhere than the map says, from where a hypothesis has them by now.

Before the drive an object is where the map has it with a probability 1 - e, N(m, P), and was moved with e,
N(m, P + s^2 I). A component knows the first alone: its posterior is N(mu, S). For a set D of moved objects the
evidence is that of the component times

    E[prod_{i in D} N(x_i; m_i, P_i + s^2 I) / N(x_i; m_i, P_i)],  x ~ N(mu, S),

which has a closed form: with C = P^-1 - (P + s^2 I)^-1 and d = mu - m it is
|P|^1/2 |P + s^2 I|^-1/2 |I - C S|^-1/2 exp(d^T (I - C S)^-1 C d / 2), blocks being those of D.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.special import logsumexp

from semantic_slam.geometry.arrays import Array

AROUND = 2
"""Objects by which the sets that are summed differ from the likeliest one at most: all sets of up to four objects if
that is one of two."""


@dataclass(frozen=True, kw_only=True)
class Displacement:
    """n objects with places of d components, as one component has them and as the map has."""

    offset: Array  # (n, d) mean less that of the map, metres
    covariance: Array  # (n d, n d) posterior
    prior: Array  # (n, d, d) covariances of the map's places
    share: float  # e
    sigma_m: float  # s

    def probabilities(self) -> Array:
        """(n,) that each was moved, given the component's history."""
        sets = list(self._around(self._likeliest()))
        logs = np.array([self._log_odds(chosen) for chosen in sets])
        weights = np.exp(logs - logsumexp(logs))
        return np.array([weights[[i in chosen for chosen in sets]].sum() for i in range(len(self.offset))])

    def _likeliest(self) -> frozenset[int]:
        """From none on, the change of one object that gains most, until none gains anything."""
        chosen, best = frozenset[int](), 0.0
        while True:
            changed = [chosen ^ {i} for i in range(len(self.offset))]
            logs = [self._log_odds(one) for one in changed]
            if not logs or max(logs) <= best:
                return chosen
            chosen, best = changed[int(np.argmax(logs))], max(logs)

    def _around(self, centre: frozenset[int]) -> Iterable[frozenset[int]]:
        for size in range(AROUND + 1):
            for changed in combinations(range(len(self.offset)), size):
                yield centre ^ set(changed)

    def _log_odds(self, chosen: frozenset[int]) -> float:
        """Log of the posterior of ``chosen`` over that of none, in nats."""
        if not chosen:
            return 0.0
        rows, size = sorted(chosen), self.offset.shape[1]
        places = (size * np.array(rows)[:, None] + np.arange(size)).ravel()
        wide = self.prior[rows] + self.sigma_m**2 * np.eye(size)
        change = np.zeros((len(places), len(places)))
        for at, (narrow, broad) in enumerate(zip(self.prior[rows], wide, strict=True)):
            block = slice(size * at, size * (at + 1))
            change[block, block] = np.linalg.inv(narrow) - np.linalg.inv(broad)
        left = np.eye(len(places)) - change @ self.covariance[np.ix_(places, places)]
        offset = self.offset[rows].ravel()
        gain = 0.5 * float(offset @ np.linalg.solve(left, change @ offset))
        volume = np.linalg.slogdet(self.prior[rows])[1].sum() - np.linalg.slogdet(wide)[1].sum()
        volume -= np.linalg.slogdet(left)[1]
        return float(len(rows) * np.log(self.share / (1.0 - self.share)) + 0.5 * volume + gain)
