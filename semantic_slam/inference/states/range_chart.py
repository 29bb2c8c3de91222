"""Retraction for points whose range is less certain than their direction: log range along the ray from an anchor.

The ``anchor`` a is the position from which the point was first seen. Direction is parametrised by where the ray meets
the plane orthogonal to the present ray, range by its logarithm. To first order the coordinates are x, y and z: with u
the direction of the point p from a, at distance d, a tangent vector t = t_r u + t_a leads to
a + exp(t_r / d) (p - a + t_a), a whole ray for all t_r. A Gaussian in x, y and z would reach behind the camera.
"""

import numpy as np

from semantic_slam.geometry.arrays import Array, squared_norms

LEAST_DISTANCE_M = 1e-3
"""Least distance of a point from its anchor: nearer, its direction is not meaningful."""
FARTHEST = 5.0
"""Limit on the change of log range in one step, which no search needs to exceed."""


def moved(anchors: Array, points: Array, tangents: Array) -> Array:
    """Retraction: (..., 3) points reached from ``points`` (..., 3) by tangent vectors (..., 3)."""
    away, unit, distance = _seen(anchors, points)
    along = np.asarray(np.vecdot(tangents, unit))
    aside = tangents - along[..., None] * unit
    return np.asarray(anchors + _stretch(along / distance)[..., None] * (away + aside))


def moved_and_slopes(anchors: Array, points: Array, tangents: Array) -> tuple[Array, Array]:
    """:func:`moved`, and its Jacobian (..., 3, 3) by the tangent vectors."""
    away, unit, distance = _seen(anchors, points)
    along = np.asarray(np.vecdot(tangents, unit))
    aside = tangents - along[..., None] * unit
    stretch = _stretch(along / distance)[..., None]
    reached = stretch * (away + aside)
    slopes = stretch[..., None] * (np.eye(3) - unit[..., :, None] * unit[..., None, :])
    slopes += (reached / distance[..., None])[..., :, None] * unit[..., None, :]
    return anchors + reached, slopes


def coordinates(anchors: Array, points: Array, others: Array) -> Array:
    """Inverse of :func:`moved`: (..., 3) tangent vectors from points (..., 3) to ``others``, in front of the anchor."""
    away, unit, distance = _seen(anchors, points)
    reached = others - anchors
    stretch = np.asarray(np.vecdot(reached, unit)) / distance
    aside = reached / stretch[..., None] - away
    return np.asarray((distance * np.log(stretch))[..., None] * unit + aside)


def relative_sigmas(anchors: Array, points: Array, covariances: Array) -> Array:
    """(...,) standard deviations of log range, from (..., 3, 3) covariances of points."""
    _, unit, distance = _seen(anchors, points)
    along = np.einsum("...i,...ij,...j->...", unit, covariances, unit)
    return np.asarray(np.sqrt(np.maximum(along, 0.0)) / distance)


def _seen(anchors: Array, points: Array) -> tuple[Array, Array, Array]:
    """Vectors (..., 3) from anchors to points, with their directions (..., 3) and lengths (...,)."""
    away = points - anchors
    distance = np.maximum(np.sqrt(squared_norms(away)), LEAST_DISTANCE_M)
    return away, away / distance[..., None], distance


def _stretch(log_ratio: Array) -> Array:
    return np.asarray(np.exp(np.clip(log_ratio, -FARTHEST, FARTHEST)))
