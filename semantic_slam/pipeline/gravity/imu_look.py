"""One look at gravity, by what an inertial sensor has told in a window before a keyframe.

Where messages state an orientation, the newest one counts. Else accelerations do, averaged along the axes of odom with
weights that rise to the middle of the window and fall again: what of that mean is the robot's own acceleration, its
odometry tells exactly, as the second difference of where the sensor was at the window's start, its middle and its end.
Left out is a window that messages or odometry do not cover, one in which the robot accelerates much, and a mean that is
not gravity's. What lasts, as an accelerometer's bias or a sensor that is mounted otherwise than stated, nothing here
sees.
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
"""[rad^2]: no sensor is mounted better than to a milliradian, whatever it states."""
MOST_AT_START_M_S2 = 3.0
"""By how much what is shown at the first keyframe may differ from gravity, which makes its look rough."""


class NoLookError(Exception):
    """Why gravity is not told at a keyframe."""


@dataclass(frozen=True)
class ImuLook:
    """What is told."""

    up: Array  # (3,) of unit length, along the body's axes
    variance: float  # [rad^2] about each of two axes across it


def look_of(
    readings: Sequence[tuple[int, ImuReading]], window: ImuWindow, settings: ImuConfiguration, *, is_first: bool
) -> ImuLook:
    """By readings with their stamps, in order; the first look of a run may be rough. Raises NoLookError."""
    for stamp_ns, reading in reversed(readings):
        if reading.up is not None:
            stated = reading.variance if np.isfinite(reading.variance) else settings.sigma_level_rad**2
            return ImuLook(window.carried(stamp_ns, reading.up), max(stated, LEAST_VARIANCE))
    shown = [(stamp_ns, reading.acceleration) for stamp_ns, reading in readings if reading.acceleration is not None]
    if not shown:
        raise NoLookError("no message within imu.window_s before a keyframe")
    stamps = np.array([stamp_ns for stamp_ns, _ in shown], dtype=np.int64)
    return _by_accelerations(window, stamps, np.array([told for _, told in shown]), settings, is_first=is_first)


def _by_accelerations(
    window: ImuWindow, stamps_ns: NDArray[np.int64], shown: Array, settings: ImuConfiguration, *, is_first: bool
) -> ImuLook:
    """By accelerations (M, 3) of the sensor."""
    if window.has_gap(stamps_ns):
        if not is_first:
            raise NoLookError("messages or odometry do not cover imu.window_s before a keyframe")
        return _rough(window, window.along_odom(stamps_ns, shown).mean(axis=0), 0.0, settings)
    own, most = window.own_acceleration(), settings.most_acceleration_m_s2
    felt, accelerates = window.mean(stamps_ns, shown) - own, float(np.linalg.norm(own))
    if accelerates > most:
        if not is_first:
            raise NoLookError("keyframe while the robot accelerates by more than imu.most_acceleration_m_s2")
        return _rough(window, felt, accelerates, settings)
    _check(felt, most)
    return ImuLook(window.in_body(felt / np.linalg.norm(felt)), settings.sigma_level_rad**2)


def _rough(window: ImuWindow, felt: Array, accelerates: float, settings: ImuConfiguration) -> ImuLook:
    """Where odometry does not tell well how the robot accelerates."""
    off = _check(felt, MOST_AT_START_M_S2)
    unknown = max(settings.most_acceleration_m_s2, accelerates, off) / GRAVITY_M_S2
    return ImuLook(window.in_body(felt / np.linalg.norm(felt)), settings.sigma_level_rad**2 + unknown**2)


def _check(felt: Array, most_m_s2: float) -> float:
    """By how much (3,) differs from gravity [m/s^2]. Raises NoLookError."""
    off = abs(float(np.linalg.norm(felt)) - GRAVITY_M_S2)
    if off > most_m_s2:
        raise NoLookError(f"accelerations that do not come to gravity, {GRAVITY_M_S2} m/s^2")
    return off
