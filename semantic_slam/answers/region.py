"""Probabilities that objects lie in a region of the map."""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.belief import HybridBelief

Region = tuple[float, float, float, float]
"""Rectangle x_min y_min x_max y_max in the map frame, metres."""


def inside(belief: HybridBelief, region: Region | None) -> Array:
    """(O,) probabilities that the objects of a belief lie in the region; None: the whole map.

    Objects that are in one of several places are there with the sum over these; all others are one Gaussian each.
    """
    found = within(belief.object_poses, belief.object_covariances, region)
    if len(belief.place_objects):
        shares = belief.place_probabilities * within(belief.place_means, belief.place_covariances, region)
        found[belief.place_objects] = 0.0
        np.add.at(found, belief.place_objects, shares)
    return found


def within(poses: Array, covariances: Array, region: Region | None) -> Array:
    """(O,) probabilities that objects lie in the region.

    ``poses`` are (O, 7), or positions (O, 3); their covariances are (O, 6, 6) or (O, 3, 3).
    """
    if region is None:
        return np.ones(len(poses))
    from scipy.stats import multivariate_normal  # deferred: the import takes 0.5 s and is only needed for a region

    lower, upper = np.array(region[:2]), np.array(region[2:])
    found = np.zeros(len(poses))
    for row, (place, spread) in enumerate(zip(poses[:, :2], covariances[:, :2, :2], strict=True)):
        if np.isfinite(place).all() and np.isfinite(spread).all():
            normal = multivariate_normal(place, spread, allow_singular=True)
            found[row] = np.clip(normal.cdf(upper, lower_limit=lower), 0.0, 1.0)
    return found
