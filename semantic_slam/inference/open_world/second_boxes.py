"""Duplicate boxes of known objects: a detector may box one thing in two halves, or two adjacent things as one.

A detected object gets a second box with probability ``second_box_share``, with a Gaussian position about the object's
and standard deviation ``second_box_m``: false alarms that are not uniform, but beside objects.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import i0e

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.open_world.births import Birth, LineOfSight
from semantic_slam.inference.smoothing.component import Component, tracked_states
from semantic_slam.inference.states.kinds.state_space import StateSpace
from semantic_slam.inference.states.tracked_objects import TrackedStates

NEAREST_M = 1e-3
"""Least distance [m] of a thing from the sensor that sees it."""


def second_boxes(
    settings: OpenWorldConfiguration, component: Component, existence: Array, births: list[Birth], detected: Array
) -> tuple[Array, Array]:
    """(G,) duplicate boxes expected in a frame, and (D, G) intensities [1/m^2 or, in space, 1/m^3] at detections.

    ``existence`` (O, G) of the component's objects now, departures included, and ``detected`` (O, G) their detection
    probabilities.
    """
    chances = settings.second_box_share * existence * detected
    expected = chances.sum(axis=0)
    if settings.second_box_share <= 0.0 or not births:
        return expected, np.zeros((len(births), len(expected)))
    densities = second_box_densities(settings, component.spaces.landmark, tracked_states(component), births)
    return expected, densities @ chances


def second_box_densities(
    settings: OpenWorldConfiguration, landmark: StateSpace, tracked: TrackedStates, births: Sequence[Birth]
) -> Array:
    """(D, O) densities [1/m^2 or, in space, 1/m^3] of duplicate boxes of each object at D detections.

    That of a detection without a range is the density of directions, spread evenly over the region along its ray.
    """
    objects = landmark.position(tracked.states)
    places, own = landmark.position(np.array([born.prior.mean for born in births])), landmark.position_rows
    size = places.shape[1]
    noise = np.array([np.trace(born.noise[own, own]) / size for born in births])
    variances = settings.second_box_m**2 + noise[:, None] + tracked.sigmas**2  # (D, O)
    squared = ((places[:, None] - objects) ** 2).sum(axis=-1)
    found = np.asarray(np.exp(-0.5 * squared / variances) / (2.0 * np.pi * variances) ** (0.5 * size))
    lines = {row: born.line for row, born in enumerate(births) if born.line is not None}
    if lines:
        slopes = landmark.position_slopes(tracked.states)
        spreads = slopes @ tracked.covariances @ np.swapaxes(slopes, 1, 2)
        spreads += settings.second_box_m**2 * np.eye(size)
        found[list(lines)] = [_along(line, objects, spreads) for line in lines.values()]
    return found


def _along(line: LineOfSight, places: Array, spreads: Array) -> Array:
    """(O,) densities along a line of sight of things at ``places`` (O, p) with covariances ``spreads`` (O, p, p).

    Directions have a von Mises-Fisher distribution, in which a thing at the sensor may be seen in any direction.
    """
    away = places - line.origin
    squared = np.maximum((away**2).sum(axis=1), NEAREST_M**2)
    depth = np.einsum("oi,oij,oj->o", away, spreads, away) / squared
    across = (np.trace(spreads, axis1=1, axis2=2) - depth) / (places.shape[1] - 1)
    concentration = 1.0 / (across / squared + line.variance)
    apart = 1.0 - (away @ line.direction) / np.sqrt(squared)  # 1 - cos(angle)
    if places.shape[1] == 2:
        per_angle = np.exp(-concentration * apart) / (2.0 * np.pi * i0e(concentration))
    else:
        per_angle = concentration * np.exp(-concentration * apart) / (-2.0 * np.pi * np.expm1(-2.0 * concentration))
    return np.asarray(per_angle * np.exp(-line.log_extent))
