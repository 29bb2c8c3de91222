"""Which objects lie in a region of the map, as far as their places are known."""

import numpy as np
from scipy.stats import multivariate_normal

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.belief import HybridBelief

Region = tuple[float, float, float, float]
"""x_min y_min x_max y_max in map, metres."""


def inside(belief: HybridBelief, region: Region | None) -> Array:
    """(O,) probabilities that the objects of a belief lie in the region; None: all of the map."""
    count = len(belief.object_ids)
    if region is None:
        return np.ones(count)
    lower, upper = np.array(region[:2]), np.array(region[2:])
    found = np.zeros(count)
    for row in range(count):
        place, spread = belief.object_poses[row, :2], belief.object_covariances[row, :2, :2]
        if np.isfinite(place).all() and np.isfinite(spread).all():
            normal = multivariate_normal(place, spread, allow_singular=True)
            found[row] = np.clip(normal.cdf(upper, lower_limit=lower), 0.0, 1.0)
    return found
