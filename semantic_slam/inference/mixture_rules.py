"""Rules that marginalise a per-object quantity over the hypotheses of a mixture (Eqs. 4.6-4.8).

Every rule takes (H,) weights that sum to one and (H, O, ...) values, and returns (O, ...). Some also take (H, O)
probabilities of existence.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array


def mean(weights: Array, values: Array) -> Array:
    """Weighted mean of (H, O, C) over all hypotheses."""
    return np.asarray(np.einsum("h,hoc->oc", weights, values))


def probability(weights: Array, values: Array) -> Array:
    """Weighted mean of a probability; NaN (a hypothesis has no such object) counts as 0."""
    return np.minimum(weights @ np.nan_to_num(values), 1.0)


def probability_if_known(weights: Array, values: Array) -> Array:
    """Like :func:`probability`, for one that not every model states; NaN where no hypothesis does."""
    return np.where(np.isfinite(values).any(axis=0), probability(weights, values), np.nan)


def mean_where_known(weights: Array, values: Array) -> Array:
    """Mean over the hypotheses whose value is not NaN, with (H,) or (H, O) weights; NaN where there is none."""
    share = weights.reshape(*weights.shape, *(1,) * (values.ndim - weights.ndim)) * np.isfinite(values)
    total = share.sum(axis=0)
    summed = (share * np.nan_to_num(values)).sum(axis=0)
    return np.where(total > 0.0, summed / np.where(total > 0.0, total, 1.0), np.nan)


def mean_if_it_exists(weights: Array, values: Array, existence: Array) -> Array:
    """Mean given that the object exists, over the hypotheses whose value is not NaN; (H, O) ``existence`` in each.

    NaN where there is none. Where an object exists in no hypothesis, they count by their weights alone.
    """
    shares = weights[:, None] * np.clip(np.nan_to_num(existence), 0.0, 1.0)
    known = np.isfinite(values).reshape(*existence.shape, -1).any(axis=2)
    shares = np.where((shares * known).any(axis=0), shares, weights[:, None])
    return mean_where_known(shares, values)


def of_most(weights: Array, values: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Majority vote: True where hypotheses of at least half the weight say so."""
    return np.asarray(weights @ values >= 0.5)


def of_the_best(weights: Array, values: NDArray[Any]) -> NDArray[Any]:
    """Value of the heaviest hypothesis."""
    return np.asarray(values[int(np.argmax(weights))])


def diagonal_moments(weights: Array, means: Array, variances: Array) -> tuple[Array, Array]:
    """(O, L) means and variances of mixtures of diagonal Gaussians (H, O, L); hypotheses with NaN are left out.

    NaN where no hypothesis has a value. L = 0 is passed through.
    """
    if not means.shape[-1]:
        return means[0], variances[0]
    share = weights[:, None, None] * np.isfinite(means)
    total = share.sum(axis=0)
    share /= np.where(total > 0.0, total, np.nan)
    known, spread = np.nan_to_num(means), np.nan_to_num(variances)
    centre = (share * known).sum(axis=0)
    return centre, np.asarray((share * (spread + (known - centre) ** 2)).sum(axis=0))
