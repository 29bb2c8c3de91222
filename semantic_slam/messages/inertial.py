"""Vertical direction from an IMU message: from its orientation where given, else from its accelerometer.

Conventions of REP 145: orientation relative to a world frame with z up, accelerations that include the reaction to
gravity, and a first covariance entry of -1 for quantities that are not provided.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from semantic_slam.geometry import so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages.sensor import plain_frame
from semantic_slam.messages.standard import header_message
from semantic_slam.messages.typestore import message_class

GRAVITY_M_S2 = 9.81
NOT_TOLD = -1.0
UNTOUCHED = np.array([0.0, 0.0, 0.0, 1.0])
"""Default orientation of a message that was not filled in (together with a zero covariance)."""
NEARLY = 0.1
"""Tolerance of a quaternion's norm about 1."""
MOST_M_S2, MOST_COVARIANCE = 1e3, 1e3
"""Largest plausible acceleration [m/s^2], and entry of a covariance [rad^2]."""
UNKNOWN_VARIANCE = 1.0
"""Variance [rad^2] of roll or pitch above which an orientation is not provided: many drivers state 1e6 for unknown."""
NO_ROTATION, NOTHING_TOLD = FAULTS = (
    "orientation that is no rotation",
    "neither an orientation nor accelerations",
)
"""Faults of single messages."""


@dataclass(frozen=True)
class ImuReading:
    """Content of one IMU message, in the frame ``frame_id``."""

    frame_id: str
    up: Array | None = None  # (3,) unit vector from the orientation; None: not provided
    variance: float = np.nan  # of ``up`` [rad^2], about each transverse axis; NaN: not provided
    acceleration: Array | None = None  # (3,) [m/s^2], upwards at rest; None: not provided
    fault: str = ""  # why a part of it cannot be used


def imu_reading(message: Any) -> ImuReading:
    """Parse a sensor_msgs/Imu."""
    frame_id, acceleration = plain_frame(message.header.frame_id), shown_acceleration(message)
    turn, covariance = _quaternion(message), np.asarray(message.orientation_covariance, dtype=np.float64)
    variance = _variance(covariance.reshape(3, 3))
    is_untouched = np.array_equal(turn, UNTOUCHED) and not covariance.any()
    is_told = covariance[0] != NOT_TOLD and not is_untouched and not covariance[[0, 4]].max() > UNKNOWN_VARIANCE
    if is_told and (np.abs(turn) < 2.0).all() and abs(np.linalg.norm(turn) - 1.0) <= NEARLY:
        return ImuReading(frame_id, so3.matrix(so3.normalised(turn))[2], variance, acceleration)
    fault = NO_ROTATION if is_told else ""
    if acceleration is None:
        fault = fault or NOTHING_TOLD
    return ImuReading(frame_id, acceleration=acceleration, fault=fault)


def shown_acceleration(message: Any) -> Array | None:
    """(3,) acceleration of a sensor_msgs/Imu; None where it is missing, implausible or exactly zero."""
    told = message.linear_acceleration
    acceleration = np.array([told.x, told.y, told.z], dtype=np.float64)
    is_told = message.linear_acceleration_covariance[0] != NOT_TOLD
    return acceleration if is_told and (np.abs(acceleration) <= MOST_M_S2).all() and acceleration.any() else None


def _quaternion(message: Any) -> Array:
    told = message.orientation
    return np.array([told.x, told.y, told.z, told.w], dtype=np.float64)


def _variance(covariance: Array) -> float:
    """Larger variance of roll and pitch, about the world axes; NaN where not provided (zeros mean unknown)."""
    if not np.isfinite(covariance[:2, :2]).all():
        return np.nan
    tilt = np.clip(covariance[:2, :2], -MOST_COVARIANCE, MOST_COVARIANCE)
    least, most = np.linalg.eigvalsh(0.5 * (tilt + tilt.T))
    return float(most) if least > 0.0 else np.nan


def imu_message(
    stamp_ns: int, frame_id: str, acceleration: Array, orientation: Array | None = None, variance: float = 0.0
) -> Any:
    """Build a sensor_msgs/Imu: ``acceleration`` (3,), ``orientation`` (4,) with ``variance`` [rad^2], or None."""
    x, y, z = (float(value) for value in acceleration)
    qx, qy, qz, qw = (float(value) for value in (UNTOUCHED if orientation is None else orientation))
    vector = message_class("geometry_msgs/msg/Vector3")
    no_turns = np.zeros(9)
    no_turns[0] = NOT_TOLD
    return message_class("sensor_msgs/msg/Imu")(
        header=header_message(stamp_ns, frame_id),
        orientation=message_class("geometry_msgs/msg/Quaternion")(x=qx, y=qy, z=qz, w=qw),
        orientation_covariance=no_turns if orientation is None else (variance * np.eye(3)).ravel(),
        angular_velocity=vector(x=0.0, y=0.0, z=0.0),
        angular_velocity_covariance=no_turns,
        linear_acceleration=vector(x=x, y=y, z=z),
        linear_acceleration_covariance=np.zeros(9),
    )
