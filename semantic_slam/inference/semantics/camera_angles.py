"""Angles from objects to the camera along the axes of map, for semantics that know how objects are turned."""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.planar.frames import camera_bearing
from semantic_slam.inference.states.spaces import Spaces, viewpoints_of


def camera_angles(spaces: Spaces, robots: Array, objects: Array, sensor: Array) -> Array:
    """(m, 2) azimuth and elevation [rad] of the cameras of ``robots`` (m, s) about ``objects`` (m, s).

    ``sensor``: the camera in the body frame. The elevation is 0 in the plane.
    """
    if spaces.name != "spatial":
        bearings = camera_bearing(robots, objects, sensor)
        return np.stack([bearings, np.zeros(len(bearings))], axis=1)
    seen = viewpoints_of(spaces.robot.displacement(robots, sensor, spaces.landmark.position(objects)))
    return np.stack([seen.azimuth_rad, seen.elevation_rad], axis=1)
