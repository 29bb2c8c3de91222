"""Expected number of first detections over the sensor's region, and their intensity at given points."""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.open_world.planar.detection_probability import NOTHING, undetected_share
from semantic_slam.inference.open_world.planar.region import SensorRegion
from semantic_slam.inference.states.detection_rates import DetectionRates

NUM_RINGS, NUM_BEARINGS = 4, 8
"""Sample points of equal area over which the region is averaged."""


def first_detections(
    region: SensorRegion,
    rates: DetectionRates,
    trail: Array,
    robot: Array,
    points: Array,
    least: float,
    hiding: Array = NOTHING,
) -> tuple[Array, Array]:
    """(G,) first detections expected from ``robot`` (3,) in the region, and (D, G) intensities [1/m^2] at ``points``.

    They are fewer where the sensor has looked before: ``trail`` (T, 3) are the robot's earlier poses, and (D, 2) points
    are in map. A share of at least ``least`` remains. Objects ``hiding`` (N, 2) occlude what is behind them.
    """
    ranges, everywhere = _all_over(region, robot)
    places = np.concatenate([everywhere, points])
    distances = np.concatenate([ranges, np.hypot(*(points - robot[:2]).T)])
    found = rates.birth_density * rates.probability * rates.fall_off(distances)
    found = rates.by_direction.times(found, places - robot[:2], region.direction_rad + robot[2])
    if least < 1.0 and len(trail):
        found = found * np.maximum(undetected_share(region, rates, trail, places, hiding), least)
    return region.area_m2 * found[: len(ranges)].mean(axis=0), found[len(ranges) :]


def _all_over(region: SensorRegion, robot: Array) -> tuple[Array, Array]:
    """(P,) ranges and (P, 2) points in map, each representing an equal part of the region."""
    centres = (np.arange(NUM_RINGS) + 0.5) / NUM_RINGS
    ranges = np.sqrt(region.min_range_m**2 + centres * (region.max_range_m**2 - region.min_range_m**2))
    bearing, range_m = (grid.ravel() for grid in np.meshgrid(region.even_bearings(NUM_BEARINGS), ranges))
    turn, reach = bearing + robot[2], range_m * region.per_range(bearing)
    return reach, robot[:2] + np.stack([reach * np.cos(turn), reach * np.sin(turn)], axis=1)
