"""Which way is up by ``imu.txt``: lines t ax ay az wx wy wz [m/s^2, rad/s] along the axes of the optical frame.

At rest an accelerometer shows what holds it, upwards. A hand that moves a camera about adds what comes to nothing on
average, once readings are turned by the camera's own attitude.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from semantic_slam.datasets.drives.tables import nanoseconds, table
from semantic_slam.datasets.space.drive import Accelerations
from semantic_slam.datasets.space.levelling import OPTICAL
from semantic_slam.datasets.space.path import SpatialPath
from semantic_slam.errors import InputError
from semantic_slam.geometry import so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages.inertial import GRAVITY_M_S2

COLUMNS = ("t", "ax", "ay", "az", "wx", "wy", "wz")
REMEDY = f"lines of '{' '.join(COLUMNS)}' are expected"
MOST_OFF_M_S2 = 1.5
"""By how much the mean may differ from gravity."""


BEFORE_NS = 2_000_000_000
"""Readings so long before odometry may be of use."""
FIRST_S = 2.0
"""Odometry's attitude drifts: without true poses the first readings count."""
LARGEST_TILT_RAD = np.deg2rad(20.0)
"""Between up by the readings and the z axis of the true poses' world, from which on their axes are others."""


def accelerations_of(file: Path, odometry: SpatialPath) -> Accelerations:
    """What is shown from a little before the camera's odometry until its end. Raises InputError."""
    stamps, values = _readings(file)
    inside = (stamps >= odometry.stamps_ns[0] - BEFORE_NS) & (stamps <= odometry.stamps_ns[-1])
    return Accelerations(stamps[inside], values[inside])


def _readings(file: Path) -> tuple[NDArray[np.int64], Array]:
    """(N,) stamps, and (N, 3) accelerations. Raises InputError."""
    rows = table(file, COLUMNS, REMEDY)
    return nanoseconds(rows[:, 0]), rows[:, 1:4]


def up_of(file: Path, odometry: SpatialPath, truth: SpatialPath | None) -> Array:
    """(3,) unit vector up in the body at the start of its odometry. Raises InputError."""
    if truth is None:
        return up_at_start(file, odometry, FIRST_S)
    known = truth.since(int(odometry.stamps_ns[0]))
    up = up_at_start(file, known)
    tilt = float(np.arccos(np.clip(so3.rotated(known.poses[0, 3:], up)[2], -1.0, 1.0)))
    if tilt > LARGEST_TILT_RAD:
        raise InputError(
            f"{file}: up by its accelerations is {np.rad2deg(tilt):.0f} degrees off the z axis of the true poses; give"
            " them along the axes of the optical frame, or remove the file"
        )
    return up


def up_at_start(file: Path, path: SpatialPath, seconds: float = np.inf) -> Array:
    """(3,) unit vector up in the body at the start of a path, by readings in its first ``seconds``.

    Raises InputError where there are none, or where their mean is not gravity.
    """
    stamps, shown = _readings(file)
    first, last = int(path.stamps_ns[0]), int(path.stamps_ns[-1])
    end = last if np.isinf(seconds) else min(last, first + round(seconds * 1e9))
    inside = np.flatnonzero((stamps >= first) & (stamps <= end))
    if not len(inside):
        raise InputError(f"{file}: no reading while the camera's pose is known; correct its times, or remove it")
    nearest = np.clip(np.searchsorted(path.stamps_ns, stamps[inside]), 0, len(path.stamps_ns) - 1)
    in_body = so3.rotated(OPTICAL[3:], shown[inside])
    start = so3.rotated(so3.inverse(path.poses[0, 3:]), so3.rotated(path.poses[nearest, 3:], in_body))
    mean = start.mean(axis=0)
    length = float(np.linalg.norm(mean))
    if abs(length - GRAVITY_M_S2) > MOST_OFF_M_S2:
        raise InputError(
            f"{file}: accelerations come to {length:.2f} m/s^2 on average, not {GRAVITY_M_S2}; give them along the axes"
            " of the optical frame, or remove the file"
        )
    return np.asarray(mean / length)
