"""Distance and direction of points in space; the direction as deviation from a ray, by the arc in the plane across it.

With a ray z, an orthonormal basis B across it and the direction u of a point, B^T u is sin(t) e, with t the arc between
both and |e| = 1, and the deviation of the point is t e. It grows by arc length for motion along the arc, and by t /
sin(t) for motion across it. On the ray, and opposite to it, the direction e is arbitrary.
"""

import math

import numpy as np

from semantic_slam.geometry.arrays import Array, squared_norms
from semantic_slam.inference.states.spaces import LEAST_DISTANCE_M

LEAST_SINE = 0.1
"""Least sine of an arc beyond a quarter turn in Jacobians across it, which are unbounded near half a turn."""

NEAREST_M = 1e-3
"""Least distance in Jacobians of directions, which are unbounded where the robot stands on an object; no camera
does."""


def distances(point: Array) -> Array:
    """(...,) metres of (..., 3) points."""
    return np.maximum(np.sqrt(squared_norms(point)), LEAST_DISTANCE_M)


def off_axis(point: Array, axis: Array) -> Array:
    """(...,) angles [rad] of (..., 3) points off an ``axis`` (3,) of length 1."""
    along = point @ axis
    return np.arctan2(np.sqrt(squared_norms(point - along[..., None] * axis)), along)


def polar(point: Array, ray: Array, basis: Array) -> Array:
    """(..., 3) distance [m] of points (..., 3), and their deviation [rad] from rays (..., 3), by basis (..., 3, 2)."""
    unit, distance = _direction(point)
    aside, sine, cosine = _arc(unit, ray, basis)
    return _polar(distance, np.arctan2(sine, cosine), aside)


def polar_and_slopes(point: Array, ray: Array, basis: Array) -> tuple[Array, Array]:
    """:func:`polar`, and (..., 3, 3) its derivatives by the point."""
    unit, distance = _direction(point)
    aside, sine, cosine = _arc(unit, ray, basis)
    bounded = np.where(cosine < 0.0, np.maximum(sine, LEAST_SINE), sine)
    arc = np.arctan2(sine, cosine)
    ratio = np.divide(arc, bounded, out=np.ones(arc.shape), where=bounded > 0.0)
    outward = (basis @ aside[..., None])[..., 0]
    along = cosine[..., None] * outward - sine[..., None] * ray
    found = np.empty((*sine.shape, 3, 3))
    found[..., 0, :] = unit
    found[..., 1:, :] = aside[..., None] * (along - ratio[..., None] * outward)[..., None, :]
    found[..., 1:, :] += ratio[..., None, None] * np.swapaxes(basis, -1, -2)
    found[..., 1:, :] /= np.maximum(distance, NEAREST_M)[..., None, None]
    return _polar(distance, arc, aside), found


def deviation(point: Array, ray: Array, basis: Array) -> Array:
    """(2,) deviation [rad] of one point (3,) from one ray: the last two of :func:`polar`, to the bit, in half its time.

    It is evaluated thousands of times in an optimisation, point by point.
    """
    _, aside, sine, cosine = _arc_of_one(point, ray, basis)
    return np.asarray(np.arctan2(sine, cosine) * aside)


def deviation_and_slopes(point: Array, ray: Array, basis: Array) -> tuple[Array, Array]:
    """:func:`deviation`, and (2, 3) its derivatives by the point, as :func:`polar_and_slopes` has them to the bit."""
    distance, aside, sine, cosine = _arc_of_one(point, ray, basis)
    arc, bounded = np.arctan2(sine, cosine), max(sine, LEAST_SINE) if cosine < 0.0 else sine
    ratio = arc / bounded if bounded > 0.0 else 1.0
    outward = (basis @ aside[:, None])[:, 0]
    slopes = aside[:, None] * (cosine * outward - sine * ray - ratio * outward)
    slopes += ratio * basis.T
    slopes /= max(distance, NEAREST_M)
    return arc * aside, slopes


def _arc_of_one(point: Array, ray: Array, basis: Array) -> tuple[float, Array, float, float]:
    """Distance of one point, and :func:`_arc`."""
    distance = max(math.sqrt(np.vecdot(point, point)), LEAST_DISTANCE_M)
    unit = point / distance
    across = (basis.T @ unit[:, None])[:, 0]
    sine = math.sqrt(np.vecdot(across, across))
    aside = across / sine if sine > 0.0 else np.array([1.0, across[1]])
    return distance, aside, sine, float(np.vecdot(ray, unit))


def _polar(distance: Array, arc: Array, aside: Array) -> Array:
    found = np.empty((*arc.shape, 3))
    found[..., 0] = distance
    found[..., 1:] = arc[..., None] * aside
    return found


def _direction(point: Array) -> tuple[Array, Array]:
    """Directions (..., 3) and distances (...,) of points."""
    distance = distances(point)
    return point / distance[..., None], distance


def _arc(unit: Array, ray: Array, basis: Array) -> tuple[Array, Array, Array]:
    """(..., 2) directions of arcs from rays to ``unit`` (..., 3), and their sines and cosines."""
    across = (np.swapaxes(basis, -1, -2) @ unit[..., None])[..., 0]
    sine = np.sqrt(squared_norms(across))
    known = sine > 0.0
    aside = across / np.where(known, sine, 1.0)[..., None]
    aside[..., 0] = np.where(known, aside[..., 0], 1.0)
    return aside, sine, np.asarray(np.vecdot(ray, unit))
