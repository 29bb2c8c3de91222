"""Occlusion by what a depth image shows: the probability that no surface is nearer than an uncertain object."""

import numpy as np
from scipy.special import ndtr, ndtri

from semantic_slam.geometry.arrays import Array, squared_norms
from semantic_slam.inference.states.spaces import LEAST_DISTANCE_M
from semantic_slam.perception.image_sight import ImageSight

BEHIND_M = 0.5
"""Least distance of an object's centre behind a surface that hides it: its own surface is before it, too."""
NUM_NODES = 7
"""Directions along each image axis over which an uncertain direction is averaged, of equal probability."""
LEAST_SIGMA_M = 1e-6

_NODES = ndtri((np.arange(NUM_NODES) + 0.5) / NUM_NODES)


def seen_before_surfaces(sight: ImageSight, seen: Array, covariance: Array, radius_m: float) -> Array:
    """(...,) probability that objects at ``seen`` (..., 3) of the optical frame, with (..., 3, 3), are before surfaces.

    A surface hides what is farther by twice ``radius_m``, or :data:`BEHIND_M`. The distance counts as normal and
    independent of the direction, whose normal is averaged over 49 nodes. Where depth is not known nothing hides.
    """
    distance = np.maximum(np.sqrt(squared_norms(seen)), LEAST_DISTANCE_M)
    unit = seen / distance[..., None]
    sigma = np.sqrt(np.vecdot(unit, (covariance @ unit[..., None])[..., 0])) + LEAST_SIGMA_M
    right, down = _directions(seen, covariance)
    free = sight.ranges_at(right, down) + max(2.0 * radius_m, BEHIND_M)
    return np.asarray(ndtr((free - distance[..., None]) / sigma[..., None]).mean(axis=-1))


def _directions(seen: Array, covariance: Array) -> tuple[Array, Array]:
    """(..., 49) tangents of equally likely directions off the optical axis, to the right and down."""
    ahead = np.maximum(seen[..., 2], LEAST_DISTANCE_M)
    middle = seen[..., :2] / ahead[..., None]
    slopes = np.zeros((*seen.shape[:-1], 2, 3))
    slopes[..., 0, 0] = slopes[..., 1, 1] = 1.0 / ahead
    slopes[..., 2] = -middle / ahead[..., None]
    spread = slopes @ covariance @ np.swapaxes(slopes, -1, -2)
    wide = np.sqrt(np.maximum(spread[..., 0, 0], 0.0))
    both = np.divide(spread[..., 0, 1], wide, out=np.zeros(wide.shape), where=wide > 0.0)
    rest = np.sqrt(np.maximum(spread[..., 1, 1] - both**2, 0.0))
    first, second = (grid.ravel() for grid in np.meshgrid(_NODES, _NODES))
    right = middle[..., :1] + wide[..., None] * first
    return right, middle[..., 1:] + both[..., None] * first + rest[..., None] * second
