"""How a quantity that H hypotheses know of O objects becomes one of their mixture: Eqs. 4.6-4.8, object by object.

Every rule takes (H,) weights that add up to one and (H, O, ...) values, and gives (O, ...).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array


def mean(weights: Array, values: Array) -> Array:
    """Average of (H, O, C) over all hypotheses."""
    return np.asarray(np.einsum("h,hoc->oc", weights, values))


def probability(weights: Array, values: Array) -> Array:
    """Average of a probability that is 0 where a hypothesis has no such object (NaN)."""
    return np.minimum(weights @ np.nan_to_num(values), 1.0)


def mean_where_known(weights: Array, values: Array) -> Array:
    """Average over the hypotheses whose value is not NaN; NaN where there is none."""
    share = weights.reshape(-1, *(1,) * (values.ndim - 1)) * np.isfinite(values)
    total = share.sum(axis=0)
    summed = (share * np.nan_to_num(values)).sum(axis=0)
    return np.where(total > 0.0, summed / np.where(total > 0.0, total, 1.0), np.nan)


def of_most(weights: Array, values: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """What hypotheses of at least half the weight say."""
    return np.asarray(weights @ values >= 0.5)


def of_the_best(weights: Array, values: NDArray[Any]) -> NDArray[Any]:
    """What the heaviest hypothesis says."""
    return np.asarray(values[int(np.argmax(weights))])


def diagonal_moments(weights: Array, means: Array, variances: Array) -> tuple[Array, Array]:
    """(O, L) means and variances of mixtures of Gaussians (H, O, L), NaN where a hypothesis has none; or all have."""
    if not means.shape[-1]:
        return means[0], variances[0]
    share = weights[:, None, None] * np.isfinite(means)
    total = share.sum(axis=0)
    share /= np.where(total > 0.0, total, np.nan)
    known, spread = np.nan_to_num(means), np.nan_to_num(variances)
    centre = (share * known).sum(axis=0)
    return centre, np.asarray((share * (spread + (known - centre) ** 2)).sum(axis=0))
