"""What a sensor_msgs/Imu tells of up, and what of it is refused."""

from typing import Any

import numpy as np
import pytest

from semantic_slam.geometry import so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages.inertial import imu_message, imu_reading
from semantic_slam.messages.typestore import deserialize, serialize

AT_REST = np.array([0.1, -0.2, 9.8])
TURN = so3.exp(np.array([0.2, -0.1, 2.0]))


def stated(**changes: Any) -> Any:
    message = imu_message(1, "/imu_link", AT_REST, TURN, 0.01)
    for name, value in changes.items():
        setattr(message, name, value)
    return message


def quaternion(x: float, y: float, z: float, w: float) -> Any:
    told = stated().orientation
    told.x, told.y, told.z, told.w = x, y, z, w
    return told


def acceleration(x: float, y: float, z: float) -> Any:
    told = stated().linear_acceleration
    told.x, told.y, told.z = x, y, z
    return told


def test_up_is_the_worlds_z_axis_along_those_of_the_sensor() -> None:
    message = deserialize(serialize(stated()), "sensor_msgs/msg/Imu")
    reading = imu_reading(message)
    np.testing.assert_allclose(reading.up, so3.rotated(so3.inverse(TURN), np.array([0.0, 0.0, 1.0])), atol=1e-12)
    assert (reading.frame_id, reading.variance, reading.fault) == ("imu_link", 0.01, "")
    np.testing.assert_array_equal(reading.acceleration, AT_REST)


def test_the_variance_is_the_larger_one_of_roll_and_pitch() -> None:
    covariance = np.diag([0.01, 0.04, 9.0]).ravel()
    assert imu_reading(stated(orientation_covariance=covariance)).variance == pytest.approx(0.04)


@pytest.mark.parametrize("covariance", [np.zeros(9), np.full(9, np.nan), -np.eye(3).ravel() * 0.5])
def test_a_covariance_that_is_none_is_not_stated(covariance: np.ndarray) -> None:
    reading = imu_reading(stated(orientation_covariance=covariance))
    assert reading.up is not None and np.isnan(reading.variance) and not reading.fault


def test_where_no_orientation_is_stated_accelerations_count() -> None:
    """By REP 145's sign, and in a message in which nobody has filled one in."""
    untouched = stated(orientation=quaternion(0.0, 0.0, 0.0, 1.0), orientation_covariance=np.zeros(9))
    for message in (imu_message(1, "imu_link", AT_REST), untouched):
        reading = imu_reading(message)
        assert reading.up is None and not reading.fault
        np.testing.assert_array_equal(reading.acceleration, AT_REST)


@pytest.mark.parametrize("told", [(0.0, 0.0, 0.0, 0.0), (np.nan, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 9.0)])
def test_an_orientation_that_is_no_rotation_is_counted_and_accelerations_count(told: tuple[float, ...]) -> None:
    reading = imu_reading(stated(orientation=quaternion(*told)))
    assert reading.up is None and reading.acceleration is not None
    assert reading.fault == "orientation that is no rotation"


@pytest.mark.parametrize("variance", [2.0, 99999.0, 1e6, 1e308])
def test_an_orientation_known_to_more_than_a_radian_is_not_stated(variance: float) -> None:
    """Nor one of which the roll alone is unknown; a heading that nobody knows is none of gravity's business."""
    for told in (variance * np.eye(3), np.diag([variance, 1e-4, 1e-4])):
        reading = imu_reading(stated(orientation_covariance=told.ravel()))
        assert reading.up is None and np.isnan(reading.variance) and not reading.fault
        np.testing.assert_array_equal(reading.acceleration, AT_REST)
    level = imu_reading(stated(orientation_covariance=np.diag([1e-4, 1e-4, variance]).ravel()))
    assert level.up is not None and level.variance == pytest.approx(1e-4)


@pytest.mark.parametrize(
    "told",
    [
        np.diag([np.inf, np.inf, np.inf]),
        np.full((3, 3), 1e6),
        np.diag([0.0, 1e6, 0.0]),
        np.diag([1e6, 0.0, 0.0]),
    ],
)
def test_an_unknown_orientation_need_have_no_regular_covariance(told: Array) -> None:
    reading = imu_reading(stated(orientation_covariance=told.ravel()))
    assert reading.up is None and not reading.fault
    np.testing.assert_array_equal(reading.acceleration, AT_REST)


@pytest.mark.parametrize("told", [(0.0, 0.0, 0.0), (np.nan, 0.0, 9.8), (np.inf, 0.0, 0.0), (1e308, 0.0, 1e308)])
def test_accelerations_that_are_none_leave_nothing(told: tuple[float, ...]) -> None:
    message = imu_message(1, "imu_link", AT_REST)
    message.linear_acceleration = acceleration(*told)
    reading = imu_reading(message)
    assert reading.acceleration is None and reading.fault == "neither an orientation nor accelerations"
