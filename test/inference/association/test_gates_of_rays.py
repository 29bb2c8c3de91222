"""Gates of rays alone, from a camera far ahead of the body: a turn of the body moves what is near the camera a lot."""

import numpy as np
import pytest

from semantic_slam.geometry import so3
from semantic_slam.inference.models.spatial.detection import SpatialDetection
from semantic_slam.inference.models.spatial.observation import POSES_AND_POINTS_IN_SPACE, SpatialObservation
from semantic_slam.inference.open_world.prediction.open_geometry import geometry_of
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.inference.states.tracked_objects import TrackedStates

TURN, SIGMAS = 0.03, 1.0
"""Standard deviation [rad] of the robot's attitude, and how many of these it is turned about the vertical."""
CAMERA, OBJECT = np.array([2.0, 0.0, 0.0]), np.array([2.5, 0.0, 0.0])
ROBOT = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
SPREAD = np.diag([TURN**2] * 3 + [1e-10] * 3)


def seen_by_the_turned_robot() -> SpatialDetection:
    away = so3.rotated(so3.exp(np.array([0.0, 0.0, -SIGMAS * TURN])), OBJECT) - CAMERA
    return SpatialDetection(
        ray=away / np.linalg.norm(away), range_m=np.nan, covariance=np.diag([np.nan, 1e-6, 1e-6]), sensor=CAMERA
    )


def test_no_ray_costs_less_than_the_bound() -> None:
    """It costs what the turn does, half its squared standard deviations; the bound had 12 nats."""
    model = SpatialObservation()
    detections = model.collect([seen_by_the_turned_robot()])
    cost, _ = model.least_cost(detections, ROBOT[None], SPREAD[None], OBJECT[None, None], np.array([1e-5]))
    assert cost[0, 0, 0] <= 0.5 * SIGMAS**2


def test_a_ray_is_as_many_sigmas_away_as_the_robot_is_turned() -> None:
    geometry, model = geometry_of(POSES_AND_POINTS_IN_SPACE), SpatialObservation()
    detections = [seen_by_the_turned_robot()]
    region = SpatialRegion(min_range_m=0.3, max_range_m=5.0, half_width_rad=0.7, half_height_rad=0.5)
    tracked = TrackedStates(
        states=OBJECT[None],
        covariances=1e-10 * np.eye(3)[None],
        sigmas=np.array([1e-5]),
        robot=ROBOT,
        robot_covariance=SPREAD,
        trail=ROBOT[None],
    )
    births = geometry.births(model, detections, ROBOT, region)
    away = geometry.sigmas_away(tracked, ROBOT, SPREAD, births, detections)
    assert away[0, 0] == pytest.approx(SIGMAS, rel=0.05)
