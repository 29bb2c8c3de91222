"""A robot that drives in a circle among objects, and what its wheels and its detector say."""

from collections.abc import Iterator

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.messages import topics
from semantic_slam.messages.codec import encode
from semantic_slam.messages.standard import OdometryEstimate
from semantic_slam_lab.simulation.detectors.told_places import told_places

RADIUS_M, SPEED_M_S = 2.0, 0.5
NUM_OBJECTS, OBJECTS_M = 12, 4.0
FARTHEST_M, HALF_VIEW_RAD = 5.0, 0.6
SIGMA_M, SIGMA_RAD = 0.05, 0.01


def sent(at_s: float, stamp_ns: int, objects: Array, chance: np.random.Generator) -> Iterator[tuple[str, bytes]]:
    """Odometry and detections of an instant."""
    angle = SPEED_M_S * at_s / RADIUS_M
    position, heading = RADIUS_M * np.array([np.cos(angle), np.sin(angle)]), angle + np.pi / 2
    pose = np.array([*position, 0.0, 0.0, 0.0, np.sin(heading / 2), np.cos(heading / 2)])
    yield topics.ODOMETRY, encode(OdometryEstimate(stamp_ns, "odom", "base_link", pose, np.zeros((6, 6))))
    ahead = objects - position
    ranges = np.hypot(*ahead.T) + chance.normal(0.0, SIGMA_M, len(objects))
    bearings = np.arctan2(ahead[:, 1], ahead[:, 0]) - heading
    bearings = np.angle(np.exp(1j * bearings)) + chance.normal(0.0, SIGMA_RAD, len(objects))
    seen = (ranges < FARTHEST_M) & (np.abs(bearings) < HALF_VIEW_RAD)
    yield topics.DETECTIONS, encode(told_places(stamp_ns, ranges[seen], bearings[seen], (SIGMA_M**2, SIGMA_RAD**2)))
