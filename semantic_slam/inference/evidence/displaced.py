"""Which objects of a map stand elsewhere than the map says, from where a hypothesis has them by now.

Before the drive an object is where the map has it with a probability 1 - e, N(m, P), and was moved with e,
N(m, P + s^2 I). A component takes each object one way, N(m, A), and not the other, N(m, B): its posterior is N(mu, S).
If it takes a set D of them wrongly, the evidence is that of the component times

    E[prod_{i in D} N(x_i; m_i, B_i) / N(x_i; m_i, A_i)],  x ~ N(mu, S),

which has a closed form: with C = A^-1 - B^-1 and d = mu - m it is
|A|^1/2 |B|^-1/2 |I - C S|^-1/2 exp(d^T (I - C S)^-1 C d / 2), blocks being those of D.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.special import logsumexp

from semantic_slam.geometry.arrays import Array, Flags

AROUND = 2
"""Objects by which the sets that are summed differ from the likeliest one at most: all sets of up to four objects if
that is one of two."""


@dataclass(frozen=True, kw_only=True)
class Displacement:
    """n objects with places of d components, as one component has them and as the map has; some were moved for it."""

    offset: Array  # (n, d) mean less that of the map, metres
    covariance: Array  # (n d, n d) posterior
    prior: Array  # (n, d, d) covariances of the map's places of what was not moved
    taken: Flags  # (n,) which the component takes to have been moved
    share: float  # e
    sigma_m: float  # s

    def probabilities(self) -> Array:
        """(n,) that each was moved, given what the component's detections are of."""
        sets = list(self._around(self._likeliest()))
        logs = np.array([self._log_odds(wrong) for wrong in sets])
        weights = np.exp(logs - logsumexp(logs))
        wrongly = np.array([weights[[i in wrong for wrong in sets]].sum() for i in range(len(self.offset))])
        return np.where(self.taken, 1.0 - wrongly, wrongly)

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

    def _log_odds(self, wrong: frozenset[int]) -> float:
        """Log of the posterior that ``wrong`` are taken the wrong way, over that none is, in nats."""
        if not wrong:
            return 0.0
        rows, size = sorted(wrong), self.offset.shape[1]
        places = (size * np.array(rows)[:, None] + np.arange(size)).ravel()
        narrow = self.prior[rows]
        wide, taken = narrow + self.sigma_m**2 * np.eye(size), self.taken[rows]
        own = np.where(taken[:, None, None], wide, narrow)
        other = np.where(taken[:, None, None], narrow, wide)
        change = np.zeros((len(places), len(places)))
        for at, matrix in enumerate(np.linalg.inv(own) - np.linalg.inv(other)):
            block = slice(size * at, size * (at + 1))
            change[block, block] = matrix
        left = np.eye(len(places)) - change @ self.covariance[np.ix_(places, places)]
        offset = self.offset[rows].ravel()
        gain = 0.5 * float(offset @ np.linalg.solve(left, change @ offset))
        volume = np.linalg.slogdet(own)[1].sum() - np.linalg.slogdet(other)[1].sum() - np.linalg.slogdet(left)[1]
        odds = np.where(taken, -1.0, 1.0).sum() * np.log(self.share / (1.0 - self.share))
        return float(odds + 0.5 * volume + gain)
