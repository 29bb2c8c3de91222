"""Expected number of first detections over the sensor's region, and their intensity at given points."""

from functools import lru_cache

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.open_world.planar.detection_probability import NOTHING, undetected_share
from semantic_slam.inference.open_world.planar.region import SensorRegion
from semantic_slam.inference.open_world.rings import NUM_EVEN, rings
from semantic_slam.inference.states.detection_rates import DetectionRates

NUM_BEARINGS = 8
"""Directions over which the region is averaged."""


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
    everywhere, fall_off, shares = _all_over(region, rates, robot)
    places = np.concatenate([everywhere, points])
    fall_off = np.concatenate([fall_off, rates.fall_off(np.hypot(*(points - robot[:2]).T))])
    found = rates.birth_density * rates.probability * fall_off
    found = rates.by_direction.times(found, places - robot[:2], region.direction_rad + robot[2])
    if least < 1.0 and len(trail):
        found = found * np.maximum(undetected_share(region, rates, trail, places, hiding), least)
    count = len(everywhere)
    area_m2 = region.area_m2 if region.is_known else 0.0
    return area_m2 * (found[:count] * (count * shares[:, None])).mean(axis=0), found[count:]


def _all_over(region: SensorRegion, rates: DetectionRates, robot: Array) -> tuple[Array, Array, Array]:
    """(P, 2) points in map, the mean fall-off (P, G) of the region's parts about them, and the parts' shares (P,)."""
    half_ranges, which = np.unique(rates.half_range_m, return_inverse=True)
    reach, bearing, fall_off, shares = _parts(region, tuple(half_ranges.tolist()))
    turn = bearing + robot[2]
    points = robot[:2] + np.stack([reach * np.cos(turn), reach * np.sin(turn)], axis=1)
    return points, fall_off[:, which], shares


@lru_cache(maxsize=256)
def _parts(region: SensorRegion, half_ranges_m: tuple[float, ...]) -> tuple[Array, Array, Array, Array]:
    """Ranges and bearings (P,) in the middle of the region's parts, the mean fall-off (P, H) about them, shares (P,).

    The fall-off is one of distance: where ranges are depths, half ranges as depths are shorter off the axis. With twice
    as many rings every second direction is left out of each, by turns. One computation serves all hypotheses.
    """
    bearings = region.even_bearings(NUM_BEARINGS)
    slopes = region.per_range(bearings)
    different, at = np.unique(slopes, return_inverse=True)
    as_ranges = (np.array(half_ranges_m) / different[:, None]).ravel()
    own = rings(region.min_range_m, region.max_range_m, tuple(as_ranges.tolist()), 2)
    count = len(own.ranges_m)
    turns = count // NUM_EVEN
    ring, direction = np.nonzero(np.arange(count)[:, None] % turns == np.arange(NUM_BEARINGS) % turns)
    fall_off = own.fall_off.reshape(count, len(different), len(half_ranges_m))[ring, at[direction]]
    reach = own.ranges_m[ring] * slopes[direction]
    return reach, bearings[direction], fall_off, own.shares[ring] * turns / NUM_BEARINGS
