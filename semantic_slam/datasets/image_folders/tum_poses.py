"""Poses of a camera in a text file as TUM's tools write them: t x y z qx qy qz qw."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from semantic_slam.datasets.drives.tables import table
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array

COLUMNS = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
REMEDY = f"lines of '{' '.join(COLUMNS)}' are expected"


def read_tum_poses(path: Path) -> tuple[Array, Array]:
    """(N,) times [s] that grow and (N, 4, 4) poses of the optical frame in some world. Raises InputError."""
    rows = table(path, COLUMNS, REMEDY)
    lengths = np.linalg.norm(rows[:, 4:], axis=1)
    if np.abs(lengths - 1.0).max() > 1e-2:
        raise InputError(f"{path}: a quaternion is of length {lengths[np.abs(lengths - 1.0).argmax()]:.3g}; {REMEDY}")
    if (np.diff(rows[:, 0]) <= 0.0).any():
        raise InputError(f"{path}: two poses at one time; {REMEDY}")
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(rows[:, 4:]).as_matrix()
    poses[:, :3, 3] = rows[:, 1:4]
    return rows[:, 0], poses
