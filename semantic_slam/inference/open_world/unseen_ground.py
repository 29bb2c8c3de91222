"""How much of the sensor's region lies where the sensor has not looked before."""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.miss_runs import MissRuns
from semantic_slam.inference.open_world.detection_probability import NOTHING, undetected_share
from semantic_slam.inference.open_world.sensor_region import SensorRegion

NUM_RINGS, NUM_BEARINGS = 4, 8
"""Points of equal area over which the region is averaged."""


def unseen_share(
    region: SensorRegion, runs: MissRuns, trail: Array, robot: Array, least: float, hiding: Array = NOTHING
) -> float:
    """Mean over the region of a robot (3,) of the share of objects not detected so far, each at least ``least``.

    ``trail`` (T, 3) are the robot's poses at the keyframes before; objects ``hiding`` (N, 2) hide what is behind them.
    """
    if least >= 1.0 or not len(trail):
        return 1.0
    centres = (np.arange(NUM_RINGS) + 0.5) / NUM_RINGS
    ranges = np.sqrt(region.min_range_m**2 + centres * (region.max_range_m**2 - region.min_range_m**2))
    bearings = region.direction_rad + region.field_of_view_rad * ((np.arange(NUM_BEARINGS) + 0.5) / NUM_BEARINGS - 0.5)
    turn, reach = (grid.ravel() for grid in np.meshgrid(bearings + robot[2], ranges))
    points = robot[:2] + np.stack([reach * np.cos(turn), reach * np.sin(turn)], axis=1)
    return float(np.maximum(undetected_share(region, runs, trail, points, hiding), least).mean())
