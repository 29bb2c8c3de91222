"""Second boxes of which only a direction is known: their density is that of directions, spread over the region."""

import numpy as np
import pytest

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry import se2, se3, so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.moments import largest_sigmas
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.planar.observation import PlanarObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.models.spatial.detection import SpatialDetection
from semantic_slam.inference.models.spatial.log_range import LogRange
from semantic_slam.inference.models.spatial.observation import SpatialObservation
from semantic_slam.inference.open_world.planar.births import births_of
from semantic_slam.inference.open_world.planar.region import SensorRegion
from semantic_slam.inference.open_world.second_boxes import second_box_densities
from semantic_slam.inference.open_world.spatial.births import births_in_space
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.inference.states.kinds.planar_poses import PlanarPoses
from semantic_slam.inference.states.kinds.spatial_positions import SpatialPositions
from semantic_slam.inference.states.tracked_objects import TrackedStates

SETTINGS = OpenWorldConfiguration(second_box_share=0.1, second_box_m=0.2)
SIGMA, COUNT = 0.03, 200_000
SPREAD = np.diag([0.3, 0.05, 0.08]) ** 2
"""Covariance of a thing's place along its own axes: better known in one direction than in another."""


def tracked(state: Array, covariance: Array) -> TrackedStates:
    robot = np.zeros_like(state)
    return TrackedStates(
        states=state[None],
        covariances=covariance[None],
        sigmas=largest_sigmas(covariance[None]),
        robot=robot,
        robot_covariance=np.zeros_like(covariance),
        trail=robot[None],
    )


def drawn_density(angles_rad: Array, dimensions: int) -> float:
    """Per radian, or per square radian, at a detection that is off drawn directions by ``angles_rad``."""
    return float(np.exp(-0.5 * (angles_rad / SIGMA) ** 2).mean() / (2.0 * np.pi * SIGMA**2) ** (0.5 * dimensions))


@pytest.mark.parametrize("heading", [0.0, 1.2])
@pytest.mark.parametrize("distance", [2.0, 5.0])
@pytest.mark.parametrize("off", [0.0, 0.1, -0.4])
def test_a_bearing_is_of_a_second_box_as_often_as_drawn_ones_are(heading: float, distance: float, off: float) -> None:
    random, robot = np.random.default_rng(0), np.array([2.0, -1.0, 0.7])
    detection = PlanarDetection(
        range_m=np.nan,
        bearing_rad=0.3,
        covariance=np.diag([np.nan, SIGMA**2]),
        sensor=np.array([0.4, -1.2]),
        feature=np.zeros(0),
        feature_covariance=np.zeros((0, 0)),
    )
    region = SensorRegion(min_range_m=0.5, max_range_m=8.0, field_of_view_rad=2.0)
    births = births_of(PlanarObservation(None, PlanarVisibility()), [detection], robot, region)
    ahead = 0.3 + off
    seen = detection.origin + distance * np.array([np.cos(ahead), np.sin(ahead)])
    thing = se2.compose(robot, np.append(seen, heading))
    density = second_box_densities(SETTINGS, PlanarPoses(), tracked(thing, SPREAD), births)[0, 0]

    turn = np.array([[np.cos(thing[2]), -np.sin(thing[2])], [np.sin(thing[2]), np.cos(thing[2])]])
    at = thing[:2] + (random.normal(size=(COUNT, 2)) * np.sqrt(np.diag(SPREAD)[:2])) @ turn.T
    at += SETTINGS.second_box_m * random.normal(size=(COUNT, 2))
    cos, sin = np.cos(robot[2]), np.sin(robot[2])
    in_body = (at - robot[:2]) @ np.array([[cos, -sin], [sin, cos]]) - detection.origin
    apart = np.arctan2(in_body[:, 1], in_body[:, 0]) - detection.bearing_rad
    found, peak = (drawn_density(apart + shift, dimensions=1) for shift in (0.0, -off))
    assert density * region.area_m2 / region.field_of_view_rad == pytest.approx(found, rel=0.12, abs=0.03 * peak)


@pytest.mark.parametrize("distance", [2.0, 4.0])
@pytest.mark.parametrize("off", [0.0, 0.1, 0.3])
def test_a_ray_is_of_a_second_box_as_often_as_drawn_ones_are(distance: float, off: float) -> None:
    random, robot = np.random.default_rng(1), se3.exp(np.array([0.4, -0.3, 0.8, 1.0, 2.0, 3.0]))
    detection = SpatialDetection(
        ray=np.array([1.0, 0.0, 0.0]),
        range_m=np.nan,
        covariance=np.diag([np.nan, SIGMA**2, SIGMA**2]),
        log_range=LogRange.between(0.3, 8.0),
    )
    region = SpatialRegion(min_range_m=0.3, max_range_m=8.0, half_width_rad=0.5, half_height_rad=0.4)
    births = births_in_space(SpatialPositions(), SpatialObservation(), [detection], robot, region)
    seen = distance * np.array([np.cos(off), 0.6 * np.sin(off), 0.8 * np.sin(off)])
    thing = robot[:3] + so3.rotated(robot[3:], seen)
    density = second_box_densities(SETTINGS, SpatialPositions(), tracked(thing, SPREAD), births)[0, 0]

    at = thing + random.multivariate_normal(np.zeros(3), SPREAD + SETTINGS.second_box_m**2 * np.eye(3), COUNT)
    in_body = so3.rotated(so3.inverse(robot[3:]), at - robot[:3])
    rays = in_body / np.linalg.norm(in_body, axis=1, keepdims=True)
    own = seen / np.linalg.norm(seen)
    found, peak = (drawn_density(np.arccos(rays @ ray), dimensions=2) for ray in (detection.ray, own))
    assert density * np.exp(births[0].log_area) == pytest.approx(found, rel=0.12, abs=0.03 * peak)


@pytest.mark.parametrize("distance", [0.0, 0.05, 0.3, 2.0])
def test_a_second_box_lies_in_some_direction_however_near_the_thing_is(distance: float) -> None:
    """The density over all bearings has an integral of 1."""
    region = SensorRegion(min_range_m=0.0, max_range_m=8.0, field_of_view_rad=2.0 * np.pi)
    bearings = np.linspace(-np.pi, np.pi, 400, endpoint=False)
    detections = [
        PlanarDetection(
            range_m=np.nan,
            bearing_rad=float(bearing),
            covariance=np.diag([np.nan, SIGMA**2]),
            sensor=np.zeros(2),
            feature=np.zeros(0),
            feature_covariance=np.zeros((0, 0)),
        )
        for bearing in bearings
    ]
    births = births_of(PlanarObservation(None, PlanarVisibility()), detections, np.zeros(3), region)
    thing = tracked(np.array([distance, 0.0, 0.0]), SPREAD)
    densities = second_box_densities(SETTINGS, PlanarPoses(), thing, births)[:, 0]
    per_radian = densities * region.area_m2 / region.field_of_view_rad
    assert per_radian.mean() * 2.0 * np.pi == pytest.approx(1.0, abs=1e-3)
