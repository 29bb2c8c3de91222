"""Which objects of a map stand elsewhere than the map says, from where a hypothesis has them by now.

Before the drive an object is where the map has it with a probability 1 - e, N(m, P), and was moved with e,
N(m, P + s^2 I). A component takes each object one way, N(m, A), and not the other, N(m, B): its posterior is N(mu, S).
If it takes a set D of them wrongly, the evidence is that of the component times

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
        logs = self._log_odds(sets)
        weights = np.exp(logs - logsumexp(logs))
        wrongly = np.array([weights[[i in wrong for wrong in sets]].sum() for i in range(len(self.offset))])
        return np.where(self.taken, 1.0 - wrongly, wrongly)

    def _likeliest(self) -> frozenset[int]:
        """From none on, the change of one object that gains most, until none gains anything."""
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
        """Log of the posterior that each set is taken the wrong way, over that none is, in nats."""
        logs, sizes = np.zeros(len(sets)), np.array([len(wrong) for wrong in sets])
        for size in np.unique(sizes[sizes > 0]):
            alike = np.flatnonzero(sizes == size)
            logs[alike] = self._log_odds_of(np.array([sorted(sets[int(i)]) for i in alike]))
        return logs

    def _log_odds_of(self, wrong: Index) -> Array:
        """(N,) for N sets of k objects each, (N, k)."""
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
        """C (n, d, d) of each object and log |A| - log |B| (n,), alone."""
        wide, taken = self.prior + self.sigma_m**2 * np.eye(self.offset.shape[1]), self.taken[:, None, None]
        own, other = np.where(taken, wide, self.prior), np.where(taken, self.prior, wide)
        return np.linalg.inv(own) - np.linalg.inv(other), np.linalg.slogdet(own)[1] - np.linalg.slogdet(other)[1]
