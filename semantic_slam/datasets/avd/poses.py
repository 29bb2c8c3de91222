"""From the poses of AVD's structure from motion to metric poses in a map frame with z up.

In the files X_cam = R X_world + t, world_pos is the camera's position, direction its optical axis, the floor is x-z.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array


def world_pose(record: Any) -> tuple[Array | None, Array, Array] | None:
    """(R or None, world_pos, direction) of one record, in the file's units; None when it tells no pose."""
    rotation, position, direction = (
        np.asarray(record[field], dtype=np.float64) for field in ("R", "world_pos", "direction")
    )
    if position.size != 3 or direction.size != 3 or not np.isfinite([position.ravel(), direction.ravel()]).all():
        return None
    return (rotation if rotation.shape == (3, 3) else None), position.ravel(), direction.ravel()


def downwards(rotations: Sequence[Array], folder: Path) -> Array:
    """(3,) unit vector: +y or -y of the world, whichever the cameras' own downward axes agree with."""
    if not rotations:
        raise InputError(f"{folder / 'image_structs.mat'}: no image has a rotation; this scene cannot be used")
    return np.array([0.0, np.sign(np.mean([rotation[1, 1] for rotation in rotations])), 0.0])


def map_axes(down: Array) -> Array:
    """(3, 3) rotation from world to map: the same x, z up, right-handed."""
    return np.array([[1.0, 0.0, 0.0], [0.0, 0.0, down[1]], -down])


def map_pose(pose: tuple[Array | None, Array, Array], axes: Array, down: Array, scale_m: float) -> Array:
    """(4, 4) T_map_camera, metres, of a :func:`world_pose`; a rotation that is missing is rebuilt."""
    rotation, position, direction = pose
    result = np.eye(4)
    result[:3, :3] = axes @ (rotation.T if rotation is not None else rotation_from_direction(direction, down))
    result[:3, 3] = axes @ position * scale_m
    return result


def rotation_from_direction(direction: Array, down: Array) -> Array:
    """(3, 3) R_world_camera of a camera that looks along ``direction`` and does not lean to a side."""
    forward = direction / np.linalg.norm(direction)
    right = np.cross(down, forward)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward], axis=1)
