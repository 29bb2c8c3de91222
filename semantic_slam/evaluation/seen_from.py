"""Viewpoint of a recorded view: where the belief has the camera stand about the object."""

from semantic_slam.geometry import so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_pose_vector
from semantic_slam.inference.models.planar.frames import camera_bearing, camera_distance
from semantic_slam.inference.states.spaces import viewpoints_of


def seen_from(pose: Array, place: Array, sensor: Array, *, in_space: bool) -> tuple[float, float, float]:
    """Azimuth and elevation in map [rad] and distance [m] of a camera from an object, as runs measure them.

    ``pose`` (7,) of the robot and ``place`` (3,) of the object in map, ``sensor`` (3,) of the camera in the body frame;
    heights count only ``in_space``, else the elevation is 0.
    """
    if in_space:
        from_object = pose[:3] + so3.rotated(pose[3:], sensor) - place
        view = viewpoints_of(from_object[None])
        return float(view.azimuth_rad[0]), float(view.elevation_rad[0]), float(view.range_m[0])
    seen = planar_from_pose_vector(pose)[None], place[None], sensor[:2]
    return float(camera_bearing(*seen)[0]), 0.0, float(camera_distance(*seen)[0])
