"""What an association frame by frame can reach: a matcher that is told the true pose and the true objects."""

import numpy as np
from scipy.optimize import linear_sum_assignment

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.pose import wrap_angle

RANGE_M, RANGE_SHARE, BEARING_RAD = 0.03, 0.03, 0.015
"""Standard deviations by which the matcher weighs errors, of ranges 0.03 m + 3 %, whatever a method takes them for."""


def matched(pose: Array, objects: Array, ranges_m: Array, bearings_rad: Array) -> Index:
    """(D,) object of every detection, the cheapest assignment one to one; -1 where there are too few objects.

    ``pose`` (3,) of the robot, ``objects`` (O, 2) in map, ranges [m] and bearings [rad] (D,) in the robot's frame.
    """
    offset = objects - pose[:2]
    distance, bearing = np.hypot(*offset.T), np.arctan2(offset[:, 1], offset[:, 0]) - pose[2]
    by_range = (ranges_m[:, None] - distance) / (RANGE_M + RANGE_SHARE * distance)
    by_bearing = wrap_angle(bearings_rad[:, None] - bearing) / BEARING_RAD
    rows, columns = linear_sum_assignment(by_range**2 + by_bearing**2)
    found = np.full(len(ranges_m), -1)
    found[rows] = columns
    return found
