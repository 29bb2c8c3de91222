"""Whether ranks are even and stated probabilities right: tests that hold together, however many the quantities."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import binom, kstest

from semantic_slam.geometry.arrays import Array

LEVEL = 0.01
BINS = 10


def p_values(ranks: Mapping[str, Sequence[float]]) -> dict[str, float]:
    """Kolmogorov-Smirnov: the band about the empirical distribution that holds at every point at once."""
    return {name: float(kstest(values, "uniform").pvalue) for name, values in ranks.items() if len(values)}


def rejected(values: Mapping[str, float], level: float = LEVEL) -> list[str]:
    """Holm's step-down procedure: names whose evenness is rejected, with one error in 1 / ``level`` sets at most."""
    found: list[str] = []
    for number, name in enumerate(sorted(values, key=lambda name: values[name])):
        if values[name] > level / (len(values) - number):
            break
        found.append(name)
    return found


def reliability(stated: Array, holds: Array) -> list[tuple[float, float, int, bool]]:
    """(mean stated, share that holds, count, whether that is credible) of each bin that has entries.

    ``stated`` (N,) and ``holds`` (N,); credible at :data:`LEVEL` over all bins, by Bonferroni.
    """
    bins = np.clip((stated * BINS).astype(int), 0, BINS - 1)
    used = np.unique(bins)
    rows = []
    for own in used:
        chosen = bins == own
        count, mean, right = int(chosen.sum()), float(stated[chosen].mean()), int(holds[chosen].sum())
        tail = min(binom.cdf(right, count, mean), binom.sf(right - 1, count, mean))
        rows.append((mean, right / count, count, bool(2.0 * tail > LEVEL / len(used))))
    return rows
