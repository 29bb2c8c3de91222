"""Decides whether a run uses topic imu."""

from collections.abc import Mapping

from semantic_slam.bag.names import absolute
from semantic_slam.configuration import Configuration
from semantic_slam.messages import topics

NAME, TYPE = absolute(topics.IMU), topics.TYPES[topics.IMU]
ANY_TILT_RAD = 0.5
"""Standard deviation of roll and pitch before the first gravity measurement."""


def unused_because(configuration: Configuration) -> str:
    """Why the configuration does not use topic imu; "" if it does, for roll and pitch."""
    if not configuration.is_spatial:
        return "a planar robot is level"
    if configuration.odometry.sigma_level_rad > 0.0:
        return "by odometry.sigma_level_rad odometry tells roll and pitch"
    return "" if configuration.imu.sigma_level_rad > 0.0 else "imu.sigma_level_rad is 0"


def left_out(configuration: Configuration, available: Mapping[str, str]) -> str:
    """Notice if there is a topic imu that the run does not use, else ""; ``available``: absolute name -> type."""
    kind = available.get(NAME, TYPE)
    if NAME in available and (reason := unused_because(configuration)):
        return f"{NAME} is not used: {reason}"
    return (
        "" if kind == TYPE else f"{NAME} is {kind}, not {TYPE}, and is not used; import_dataset bag --imu takes another"
    )
