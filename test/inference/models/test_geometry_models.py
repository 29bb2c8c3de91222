"""The geometric observation models under their contract."""

import numpy as np
from worlds.linear_gaussian import LinearDetection, LinearModel
from worlds.points import BodyPointObservation

from semantic_slam.contracts.geometry_model import GeometryModelContract
from semantic_slam.inference.models.planar.observation import PlanarObservation
from semantic_slam.inference.models.planar.point_observation import POSES_AND_POINTS, PointObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.models.planar_detection import PlanarDetection
from semantic_slam.inference.states.planar_poses import PlanarPoses
from semantic_slam.inference.states.planar_positions import PlanarPositions
from semantic_slam.inference.states.spaces import Spaces

COVARIANCE = np.array([[0.1, 0.01], [0.01, 0.05]])
NONE = np.zeros(0)


def sighting(range_m: float, bearing_rad: float) -> PlanarDetection:
    return PlanarDetection(
        range_m=range_m,
        bearing_rad=bearing_rad,
        covariance=COVARIANCE,
        sensor=np.array([0.2, -0.1]),
        feature=NONE,
        feature_covariance=np.zeros((0, 0)),
    )


def robots(random: np.random.Generator, count: int) -> np.ndarray:
    return random.normal(scale=[0.5, 0.5, 1.0], size=(count, 3))


def landmarks(random: np.random.Generator, count: int, size: int) -> np.ndarray:
    return random.normal(loc=np.array([3.0, 0.0, 0.0])[:size], size=(count, size))


class TestRangeAndBearingOfPoses(GeometryModelContract):
    spaces, model = Spaces.same(PlanarPoses()), PlanarObservation(None, PlanarVisibility())
    detections = (sighting(2.0, 0.3), sighting(3.0, -0.4))

    def pairs(self, random: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
        return robots(random, count), landmarks(random, count, 3)


class TestBearingOfPoses(TestRangeAndBearingOfPoses):
    """From a camera off the body's origin."""

    detections = (sighting(np.nan, 0.3), sighting(np.nan, -0.4))


class TestRangeAndBearingOfPoints(GeometryModelContract):
    spaces, model = POSES_AND_POINTS, PointObservation()
    detections = (sighting(2.0, 0.3), sighting(3.0, -0.4))

    def pairs(self, random: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
        return robots(random, count), landmarks(random, count, 2)

    def test_points_are_poses_whose_heading_does_not_matter(self, random: np.random.Generator) -> None:
        x, o = self.pairs(random, 6)
        turned = np.column_stack([o, random.uniform(-3.0, 3.0, 6)])
        poses = PlanarObservation(None, PlanarVisibility())
        for seen in (self.model.collect(self.detections), self.model.collect(self.detections[:1])):
            point, pose = self.model.geometry(seen, x, o), poses.geometry(seen, x, turned)
            np.testing.assert_allclose(point.residual, pose.residual, atol=1e-12)
            np.testing.assert_allclose(point.jacobian_robot, pose.jacobian_robot, atol=1e-12)
            covariance = np.tile(0.3 * np.eye(6), (6, 1, 1))
            charts = np.tile(np.eye(6), (6, 1, 1))
            own = self.model.bearing_sigma(x, o, covariance[:, :5, :5], charts[:, :5, :5])
            np.testing.assert_allclose(own, poses.bearing_sigma(x, turned, covariance, charts), atol=1e-12)


class TestBearingOfPoints(TestRangeAndBearingOfPoints):
    detections = (sighting(np.nan, 0.3), sighting(np.nan, -0.4))


class TestPointsInTheBodyFrame(GeometryModelContract):
    """The linear stand-in of the closed forms."""

    spaces, model = POSES_AND_POINTS, BodyPointObservation(COVARIANCE)
    detections = (np.array([2.0, 0.5]), np.array([2.5, -1.0]))

    def pairs(self, random: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
        return robots(random, count), landmarks(random, count, 2)


class TestOffsetsOfPositions(GeometryModelContract):
    spaces = Spaces.same(PlanarPositions())
    model = LinearModel(COVARIANCE, np.eye(2), np.zeros((0, 2)), np.zeros((0, 2, 2)), 0)
    detections = tuple(LinearDetection(np.array(offset), np.zeros(2)) for offset in ([2.0, 0.5], [2.5, -1.0]))

    def pairs(self, random: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
        return landmarks(random, count, 2), landmarks(random, count, 2)
