"""Duplicate boxes of known objects: a detector may box one thing in two halves, or two adjacent things as one.

A detected object gets a second box with probability ``second_box_share``, with a Gaussian position about the object's
and standard deviation ``second_box_m``: false alarms that are not uniform, but beside objects.
"""

from collections.abc import Sequence

import numpy as np

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.open_world.births import Birth
from semantic_slam.inference.smoothing.component import Component, tracked_states


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
    return expected, second_box_densities(settings, component, births) @ chances


def second_box_densities(settings: OpenWorldConfiguration, component: Component, births: Sequence[Birth]) -> Array:
    """(D, O) densities [1/m^2 or, in space, 1/m^3] of duplicate boxes of each object at D detections."""
    tracked = tracked_states(component)
    landmark = component.spaces.landmark
    places, own = landmark.position(np.array([born.prior.mean for born in births])), landmark.position_rows
    size = places.shape[1]
    noise = np.array([np.trace(born.noise[own, own]) / size for born in births])
    variances = settings.second_box_m**2 + noise[:, None] + tracked.sigmas**2  # (D, O)
    squared = ((places[:, None] - landmark.position(tracked.states)) ** 2).sum(axis=-1)
    return np.asarray(np.exp(-0.5 * squared / variances) / (2.0 * np.pi * variances) ** (0.5 * size))
