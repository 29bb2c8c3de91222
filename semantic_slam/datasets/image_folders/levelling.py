"""A camera that is held by hand as a robot in the plane: a level body at the camera, x along its viewing direction."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array

STEEPEST_RAD = np.deg2rad(80.0)
"""A camera that looks up or down more steeply has no direction in the plane."""


@dataclass(frozen=True)
class LevelPath:
    """F instants of a camera that was made level by gravity."""

    poses: Array  # (F, 3) x y [m] yaw [rad] of the body, in the plane
    R_body_camera: Array  # (F, 3, 3) of the optical frame


def levelled(T_world_camera: Array, down: Array) -> LevelPath:
    """The path of (F, 4, 4) poses, made level by the (3,) unit vector ``down`` in their world.

    The plane's x axis is the direction in which the first camera looks. Raises InputError where one looks up or down.
    """
    up, axes = -down, T_world_camera[:, :3, 2]
    level = axes - (axes @ up)[:, None] * up
    lengths = np.linalg.norm(level, axis=1)
    steep = np.flatnonzero(lengths < np.cos(STEEPEST_RAD))
    if len(steep):
        raise InputError(
            f"frame {steep[0]}: the camera looks straight up or down, which has no heading in the plane; leave such"
            " frames out, or correct the direction of gravity"
        )
    forward = level / lengths[:, None]
    R_world_body = np.stack([forward, np.cross(up, forward), np.broadcast_to(up, forward.shape)], axis=2)
    R_world_plane = R_world_body[0]
    positions = (T_world_camera[:, :3, 3] - T_world_camera[0, :3, 3]) @ R_world_plane
    headings = forward @ R_world_plane
    poses = np.column_stack([positions[:, :2], np.unwrap(np.arctan2(headings[:, 1], headings[:, 0]))])
    return LevelPath(poses, np.swapaxes(R_world_body, 1, 2) @ T_world_camera[:, :3, :3])


def at_times(times_s: Array, poses: Array, wanted_s: Array) -> tuple[Array, NDArray[np.bool_]]:
    """(N, 4, 4) poses at ``wanted_s`` by the nearest of ``poses`` (M, 4, 4), and whether it is within half a step."""
    after = np.clip(np.searchsorted(times_s, wanted_s), 1, len(times_s) - 1) if len(times_s) > 1 else 0
    before = np.maximum(after - 1, 0)
    nearest = np.where(wanted_s - times_s[before] <= times_s[after] - wanted_s, before, after)
    step = float(np.median(np.diff(times_s))) if len(times_s) > 1 else 0.0
    return poses[nearest], np.abs(times_s[nearest] - wanted_s) <= 0.5 * step + 1e-3


def quaternion_of(rotation: Array) -> Array:
    """(4,) qx qy qz qw of a (3, 3) rotation matrix."""
    return np.asarray(Rotation.from_matrix(rotation).as_quat())
