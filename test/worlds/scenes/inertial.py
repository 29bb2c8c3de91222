"""An inertial sensor on a body that flies: what it shows of gravity and of its own motion, with noise and a bias."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from semantic_slam.datasets.drives.drive import Message
from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages import topics
from semantic_slam.messages.inertial import GRAVITY_M_S2, imu_message
from semantic_slam.messages.standard import NANOSECONDS

GRAVITY = np.array([0.0, 0.0, GRAVITY_M_S2])
"""What holds a body at rest [m/s^2], in map."""
STEP_S = 1e-3
"""Between positions whose second difference is an acceleration."""


@dataclass(frozen=True, kw_only=True)
class Imu:
    """How a sensor is mounted and how it errs."""

    T_body_imu: Array  # (7,)
    frame_id: str = "imu_link"
    rate_hz: float = 100.0
    noise_m_s2: float = 0.05  # white
    bias_m_s2: float = 0.05  # along each axis, drawn once
    tilt_rad: float | None = None  # white, about two axes, of the orientation that it states; None: it states none


class SmoothPath:
    """A body that flies through (K, 7) poses in map at times (K,) [s] without a jerk."""

    def __init__(self, times_s: Array, poses: Array) -> None:
        self._positions = CubicSpline(times_s, poses[:, :3])
        self._turns = RotationSpline(times_s, Rotation.from_quat(poses[:, 3:]))

    def at(self, times_s: Array) -> Array:
        """(N, 7) poses in map."""
        return se3.wrapped(np.hstack([self._positions(times_s), self._turns(times_s).as_quat()]))

    def shown(self, times_s: Array, T_body_imu: Array) -> Array:
        """(N, 3) accelerations [m/s^2] along the axes of a sensor at a pose (7,) of the body."""
        before, now, after = (se3.compose(self.at(times_s + step), T_body_imu) for step in (-STEP_S, 0.0, STEP_S))
        own = (before[:, :3] - 2.0 * now[:, :3] + after[:, :3]) / STEP_S**2
        return so3.rotated(so3.inverse(now[:, 3:]), own + GRAVITY)


def imu_messages(
    path: SmoothPath, imu: Imu, times_s: tuple[float, float], random: np.random.Generator
) -> list[Message]:
    """Topic imu from one time to another."""
    times = np.arange(times_s[0], times_s[1], 1.0 / imu.rate_hz)
    bias = imu.bias_m_s2 * random.standard_normal(3)
    shown = path.shown(times, imu.T_body_imu) + bias + imu.noise_m_s2 * random.standard_normal((len(times), 3))
    turns = se3.compose(path.at(times), imu.T_body_imu)[:, 3:]
    return list(_messages(imu, np.round(times * NANOSECONDS).astype(np.int64), shown, turns, random))


def _messages(imu: Imu, stamps_ns: Array, shown: Array, turns: Array, random: np.random.Generator) -> Iterator[Message]:
    for stamp_ns, acceleration, turn in zip(stamps_ns.tolist(), shown, turns, strict=True):
        if imu.tilt_rad is None:
            message = imu_message(stamp_ns, imu.frame_id, acceleration)
        else:
            told = so3.product(so3.exp(np.append(imu.tilt_rad * random.standard_normal(2), 0.0)), turn)
            message = imu_message(stamp_ns, imu.frame_id, acceleration, told, imu.tilt_rad**2)
        yield stamp_ns, topics.IMU, message
