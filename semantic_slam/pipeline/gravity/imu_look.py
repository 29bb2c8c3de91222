"""Measures the gravity direction from the IMU readings in a window before a keyframe.

If messages contain an orientation, the newest one is used. Otherwise accelerations are averaged along the axes of odom,
with triangular weights over the window. The share of the robot's own acceleration in that mean is exactly the second
difference of the sensor's positions, by odometry, at the start, the middle and the end of the window. Rejected are
windows that messages or odometry do not cover, windows in which the robot accelerates too much, and means whose norm is
not that of gravity. Constant errors, such as an accelerometer bias or wrong extrinsics, are not detected.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.configuration import ImuConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages.inertial import GRAVITY_M_S2, ImuReading
from semantic_slam.pipeline.gravity.imu_window import ImuWindow

LEAST_VARIANCE = 1e-6
"""Lower limit [rad^2] of the variance: sensors are not mounted more accurately than to a milliradian."""
MOST_AT_START_M_S2 = 3.0
"""Largest difference from gravity [m/s^2] of the rough measurement at the first keyframe."""
NO_GRAVITY = "accelerations that do not come to gravity"


class NoLookError(Exception):
    """Raised with the reason why gravity cannot be measured at a keyframe."""


@dataclass(frozen=True)
class ImuLook:
    """A measured gravity direction."""

    up: Array  # (3,) unit vector in the body frame
    variance: float  # [rad^2] about each of two axes across it


def look_of(
    readings: Sequence[tuple[int, ImuReading]], window: ImuWindow, settings: ImuConfiguration, *, is_first: bool
) -> ImuLook:
    """Measure gravity from (stamp, reading) in stamp order; the first of a run may be rough. Raises NoLookError."""
    for stamp_ns, reading in reversed(readings):
        if reading.up is not None:
            stated = reading.variance if np.isfinite(reading.variance) else settings.sigma_level_rad**2
            return ImuLook(window.carried(stamp_ns, reading.up), max(stated, LEAST_VARIANCE))
    return look_by_accelerations(readings, window, settings, is_first=is_first)


def look_by_accelerations(
    readings: Sequence[tuple[int, ImuReading]], window: ImuWindow, settings: ImuConfiguration, *, is_first: bool
) -> ImuLook:
    """Measure gravity by accelerations alone, as :func:`look_of`. Raises NoLookError."""
    shown = [(stamp_ns, reading.acceleration) for stamp_ns, reading in readings if reading.acceleration is not None]
    if not shown:
        raise NoLookError("neither an orientation nor accelerations within imu.window_s before a keyframe")
    stamps = np.array([stamp_ns for stamp_ns, _ in shown], dtype=np.int64)
    return _by_accelerations(window, stamps, np.array([told for _, told in shown]), settings, is_first=is_first)


def _by_accelerations(
    window: ImuWindow, stamps_ns: NDArray[np.int64], shown: Array, settings: ImuConfiguration, *, is_first: bool
) -> ImuLook:
    """Measure gravity from accelerations (M, 3) [m/s^2] in the sensor frame. Raises NoLookError."""
    if window.has_gap(stamps_ns):
        if not is_first:
            raise NoLookError("messages or odometry do not cover imu.window_s before a keyframe")
        felt = window.along_odom(stamps_ns, shown).mean(axis=0)
        return _rough(window, felt, float(np.linalg.norm(window.known_acceleration())), settings)
    own, most = window.own_acceleration(), settings.most_acceleration_m_s2
    felt, accelerates = window.mean(stamps_ns, shown) - own, float(np.linalg.norm(own))
    if accelerates > most:
        if not is_first:
            raise NoLookError("keyframe while the robot accelerates by more than imu.most_acceleration_m_s2")
        return _rough(window, felt, accelerates, settings)
    _check(felt, most)
    return ImuLook(window.in_body(felt / np.linalg.norm(felt)), settings.sigma_level_rad**2)


def _rough(window: ImuWindow, felt: Array, accelerates: float, settings: ImuConfiguration) -> ImuLook:
    """Measurement with a larger variance, where the robot's own acceleration is large or not well known."""
    off = _check(felt, MOST_AT_START_M_S2)
    unknown = max(settings.most_acceleration_m_s2, accelerates, off) / GRAVITY_M_S2
    return ImuLook(window.in_body(felt / np.linalg.norm(felt)), settings.sigma_level_rad**2 + unknown**2)


def _check(felt: Array, most_m_s2: float) -> float:
    """Difference [m/s^2] between the norm of (3,) and gravity. Raises NoLookError if it exceeds ``most_m_s2``."""
    off = abs(float(np.linalg.norm(felt)) - GRAVITY_M_S2)
    if off > most_m_s2:
        raise NoLookError(f"{NO_GRAVITY}, {GRAVITY_M_S2} m/s^2")
    return off
