"""Odometry whose frame is level tells roll and pitch at keyframes, as often as its errors are new."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from semantic_slam_lab.simulation.tables import Flight, table_tops
from semantic_slam_lab.studies.tables.run import configuration
from worlds.bags.imported import read_bag
from worlds.bags.table_bag import in_space, table_entries, write_table_bag

from semantic_slam.configuration import OdometryConfiguration
from semantic_slam.geometry import so3
from semantic_slam.inference.inputs.keyframe import OdometrySample
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.pipeline.gravity.level import level_at
from semantic_slam.pipeline.odometry.motion import OdometryPoint, start
from semantic_slam.pipeline.offline import run_bag

LEVEL = OdometryConfiguration(sigma_level_rad=0.02, level_repeats_s=10.0)


def point(stamp_s: float, roll_rad: float = 0.0, yaw_rad: float = 0.0) -> OdometryPoint:
    turn = so3.product(so3.exp(np.array([0.0, 0.0, yaw_rad])), so3.exp(np.array([roll_rad, 0.0, 0.0])))
    return start(OdometrySample(round(stamp_s * 1e9), np.append([1.0, 2.0, 0.5], turn)))


def test_up_is_where_odometry_has_it_whatever_the_heading() -> None:
    for yaw_rad in (0.0, 2.0):
        found = level_at(point(0.0, 0.3, yaw_rad), None, LEVEL)
        np.testing.assert_allclose(found, [0.0, np.sin(0.3), np.cos(0.3), 0.02**2], atol=1e-12)


def test_looks_within_the_time_in_which_errors_repeat_count_as_one() -> None:
    looks = [level_at(point(0.5 * n), point(0.5 * (n - 1)), LEVEL) for n in range(1, 21)]
    assert sum(1.0 / look[3] for look in looks) == pytest.approx(1.0 / 0.02**2)
    assert level_at(point(30.0), point(0.0), LEVEL)[3] == pytest.approx(0.02**2)


def test_after_a_jump_up_is_where_odometry_has_it_now() -> None:
    tilted = point(1.0, 0.3, 2.0)
    jumped = point(0.0).after_jump_to(OdometrySample(tilted.stamp_ns, tilted.pose))
    np.testing.assert_allclose(level_at(jumped, None, LEVEL), level_at(tilted, None, LEVEL), atol=1e-12)


def test_odometry_that_was_missing_tells_no_level() -> None:
    assert level_at(replace(point(1.0), sigma_rad=0.1), None, LEVEL) is None
    assert level_at(point(1.0), None, OdometryConfiguration()) is None


def test_a_bag_with_level_odometry_keeps_roll_and_pitch(tmp_path: Path) -> None:
    flight = Flight(keyframes=8, things=4)
    room = table_tops(flight, SpatialRegion.of(configuration().open_world), np.random.default_rng(5))
    bag, sigmas = write_table_bag(tmp_path / "bag", table_entries(room)), []
    for name, settings in (("level", replace(LEVEL, level_repeats_s=0.0, sigma_level_rad=1e-3)), ("not", None)):
        base = in_space()
        run_bag(bag, tmp_path / name, base if settings is None else replace(base, odometry=settings))
        last = read_bag(tmp_path / name)["/hypothesis_manager/belief"][-1]
        sigmas.append(float(np.sqrt(np.diagonal(last.pose_covariances[0])[3:5]).max()))
    assert sigmas[0] < 1e-3 < 2e-3 < sigmas[1]
