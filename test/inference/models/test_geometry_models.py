"""The geometric observation models under their contract."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from worlds.exact.linear_gaussian import LinearDetection, LinearModel
from worlds.scenes.points import BodyPointObservation

from semantic_slam.contracts.geometry_model import KEYS, GeometryModelContract
from semantic_slam.geometry import se3, so3
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.planar.observation import PlanarObservation
from semantic_slam.inference.models.planar.point_observation import POSES_AND_POINTS, PointObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.models.point_geometry import PointGeometry
from semantic_slam.inference.models.spatial.bodies import BodyObservation
from semantic_slam.inference.models.spatial.detection import SpatialDetection
from semantic_slam.inference.models.spatial.observation import POSES_AND_POINTS_IN_SPACE, SpatialObservation
from semantic_slam.inference.models.spatial.ray import deviation, deviation_and_slopes, polar, polar_and_slopes
from semantic_slam.inference.models.spatial.views import POSES_IN_SPACE
from semantic_slam.inference.states.kinds.planar_poses import PlanarPoses
from semantic_slam.inference.states.kinds.planar_positions import PlanarPositions
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


def looking(range_m: float, ray: list[float], covariance: np.ndarray) -> SpatialDetection:
    return SpatialDetection(ray=np.array(ray) / np.linalg.norm(ray), range_m=range_m, covariance=covariance)


class TestRangeAndRayOfPoints(GeometryModelContract):
    """An elongated error that goes with that of the range: a factor in Python."""

    spaces, model = POSES_AND_POINTS_IN_SPACE, SpatialObservation()
    spread = np.array([[0.1, 0.02, -0.01], [0.02, 0.05, 0.01], [-0.01, 0.01, 0.02]])
    detections = (looking(2.0, [1.0, 0.3, -0.2], spread), looking(3.0, [1.0, -0.4, 0.5], spread))

    def pairs(self, random: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
        x = se3.exp(random.normal(scale=[1.0, 1.0, 1.0, 0.5, 0.5, 0.5], size=(count, 6)))
        return x, random.normal(loc=[3.0, 0.0, 0.0], size=(count, 3))

    def test_a_ray_is_off_by_the_arc(self, random: np.random.Generator) -> None:
        x, o = self.pairs(random, 8)
        points, (ray, basis) = self.spaces.relative_position(x, o).point, self.rays()
        expected = np.arccos(np.clip(points @ ray / np.linalg.norm(points, axis=1), -1.0, 1.0))
        np.testing.assert_allclose(np.linalg.norm(polar(points, ray, basis)[:, 1:], axis=1), expected, atol=1e-9)
        for off in (1e-12, 1e-9, 1e-5):
            away = 2.0 * (np.cos(off) * ray + np.sin(off) * basis[:, 1])
            np.testing.assert_allclose(polar(away, ray, basis), [2.0, 0.0, off], rtol=1e-6, atol=1e-16)
            assert np.linalg.norm(polar(-away, ray, basis)[1:]) == pytest.approx(np.pi - off, abs=1e-12)
        assert np.linalg.norm(polar(-ray, ray, basis)[1:]) == pytest.approx(np.pi)
        assert np.isfinite(polar_and_slopes(-ray, ray, basis)[1]).all()

    def test_two_points_tell_how_the_robot_is_turned_about_the_vertical(self, random: np.random.Generator) -> None:
        x, points = self.pairs(random, 1)[0], random.normal(loc=[3.0, 0.0, 0.0], size=(2, 1, 3))
        body = [self.spaces.relative_position(x, point).point[0] for point in points]
        seen = self.model.collect([looking(float(np.linalg.norm(p)), p, self.spread) for p in body])
        turned = se3.compose(se3.exp(np.array([[0.0, 0.0, 2.5, 1.0, -3.0, 0.5]])), x)
        found = self.model.turned_start(seen, turned, *points)
        np.testing.assert_allclose(se3.log(se3.between(found, x)), 0.0, atol=1e-9)

    def rays(self) -> tuple[np.ndarray, np.ndarray]:
        return self.detections[0].ray, self.detections[0].basis


class TestRangeAndRoundRayOfPoints(TestRangeAndRayOfPoints):
    """GTSAM's own factor: its error and what it pulls at are exact; how it bends, where points are near the ray."""

    spread = np.diag([0.1, 0.02, 0.02])
    detections = (looking(2.0, [1.0, 0.3, -0.2], spread), looking(3.0, [1.0, -0.4, 0.5], spread))

    def test_gtsam_s_factor_is_the_whitened_residual(self, random: np.random.Generator) -> None:
        for detection in self.detections:
            assert isinstance(self.model.geometry_factor(detection, KEYS), gtsam.BearingRangeFactor3D)
            for off, tolerance in ((1.0, np.inf), (1e-4, 1e-6)):
                x, _ = self.pairs(random, 1)
                near = detection.range_m * detection.ray + off * random.normal(size=3)
                o = self.spaces.robot.displacement(x, near, np.zeros(3))
                part, values = self.model.geometry(self.model.collect([detection]), x, o), gtsam.Values()
                self.spaces.robot.insert(values, KEYS[0], x[0])
                self.spaces.landmark.insert(values, KEYS[1], o[0])
                factor = self.model.geometry_factor(detection, KEYS)
                assert factor.error(values) == pytest.approx(0.5 * float((part.residual**2).sum()), rel=1e-9)
                jacobian, right = factor.linearize(values).jacobian()
                expected = np.hstack([part.jacobian_robot[0], part.jacobian_object[0]])
                np.testing.assert_allclose(-jacobian.T @ right, expected.T @ part.residual[0], atol=1e-9)
                assert np.abs(jacobian.T @ jacobian - expected.T @ expected).max() < tolerance


def ray_alone(direction: list[float], spread: np.ndarray, sensor: tuple[float, float, float]) -> SpatialDetection:
    covariance = np.full((3, 3), np.nan)
    covariance[1:, 1:] = spread
    ray = np.array(direction) / np.linalg.norm(direction)
    return SpatialDetection(ray=ray, range_m=np.nan, covariance=covariance, sensor=np.array(sensor))


class TestRaysOfPoints(TestRangeAndRayOfPoints):
    """From a camera off the body's origin, and without a range."""

    spread = np.array([[0.02, 0.005], [0.005, 0.03]])
    detections = (
        ray_alone([1.0, 0.3, -0.2], spread, (0.3, -0.1, 0.2)),
        ray_alone([1.0, -0.4, 0.5], spread, (0.3, -0.1, 0.2)),
    )

    def test_two_points_tell_how_the_robot_is_turned_about_the_vertical(self, random: np.random.Generator) -> None:
        """Not by rays alone: the robot stays where it was."""
        x, points = self.pairs(random, 1)[0], random.normal(loc=[3.0, 0.0, 0.0], size=(2, 1, 3))
        np.testing.assert_array_equal(self.model.turned_start(self.model.collect(self.detections), x, *points), x)


class TestRoundRaysOfPoints(TestRaysOfPoints):
    """GTSAM's own factor, of a camera at the body's origin."""

    detections = tuple(
        ray_alone(ray, 0.02 * np.eye(2), (0.0, 0.0, 0.0)) for ray in ([1.0, 0.3, -0.2], [1.0, -0.4, 0.5])
    )

    def test_gtsam_s_factor_is_the_whitened_residual(self, random: np.random.Generator) -> None:
        for detection in self.detections:
            x, o = self.pairs(random, 1)
            part, values = self.model.geometry(self.model.collect([detection]), x, o), gtsam.Values()
            self.spaces.robot.insert(values, KEYS[0], x[0])
            self.spaces.landmark.insert(values, KEYS[1], o[0])
            factor = self.model.geometry_factor(detection, KEYS)
            assert isinstance(factor, gtsam.BearingFactor3D)
            assert factor.error(values) == pytest.approx(0.5 * float((part.residual**2).sum()), rel=1e-9)


@pytest.mark.parametrize("sensor", [(0.0, 0.0, 0.0), (0.1, 0.0, 0.2)])
def test_a_ray_pulls_as_a_gaussian_near_its_object_and_the_less_the_farther_it_is_off(
    sensor: tuple[float, float, float],
) -> None:
    """By a Cauchy distribution of 2 standard deviations: that of a Gaussian at 0, half of it at 2, a tenth at 6."""
    robust, plain = SpatialObservation(ray_tail=2.0), SpatialObservation()
    detection = ray_alone([1.0, 0.0, 0.0], 0.01**2 * np.eye(2), sensor)
    for sigmas, share in ((1e-3, 1.0), (2.0, 0.5), (6.0, 0.1)):
        values, off = gtsam.Values(), sigmas * 0.01
        values.insert(KEYS[0], gtsam.Pose3())
        values.insert(KEYS[1], np.array(sensor) + 2.0 * np.array([np.cos(off), np.sin(off), 0.0]))
        linear = [model.geometry_factor(detection, KEYS).linearize(values).jacobian() for model in (robust, plain)]
        pulls = [float(np.linalg.norm(slopes.T @ off)) for slopes, off in linear]
        assert pulls[0] / pulls[1] == pytest.approx(share, rel=1e-3)


class TestRangeAndRayOfBodies(GeometryModelContract):
    spaces, model = POSES_IN_SPACE, BodyObservation()
    detections = TestRangeAndRayOfPoints.detections

    def pairs(self, random: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
        x = se3.exp(random.normal(scale=[1.0, 1.0, 1.0, 0.5, 0.5, 0.5], size=(count, 6)))
        turned = se3.exp(random.normal(scale=[1.0, 1.0, 1.0, 0.0, 0.0, 0.0], size=(count, 6)))
        turned[:, :3] = random.normal(loc=[3.0, 0.0, 0.0], size=(count, 3))
        return x, turned

    def test_bodies_are_points_whose_attitude_does_not_matter(self, random: np.random.Generator) -> None:
        x, o = self.pairs(random, 6)
        seen, points = self.model.collect(self.detections), SpatialObservation()
        body, point = self.model.geometry(seen, x, o), points.geometry(seen, x, o[:, :3])
        np.testing.assert_allclose(body.residual, point.residual, atol=1e-12)
        np.testing.assert_allclose(body.jacobian_robot, point.jacobian_robot, atol=1e-12)
        for soft in (False, True):
            own = self.model.log_visibility(x, o, soft=soft)
            np.testing.assert_allclose(own, points.log_visibility(x, o[:, :3], soft=soft), atol=1e-12)

    def test_gtsam_s_own_factor_is_that_of_points(self) -> None:
        round_ray = looking(2.0, [1.0, 0.3, -0.2], TestRangeAndRoundRayOfPoints.spread)
        assert isinstance(self.model.geometry_factor(round_ray, KEYS), gtsam.BearingRangeFactorPose3)

    def test_a_new_object_stands_upright(self, random: np.random.Generator) -> None:
        yaw, tilt = (so3.exp(np.array(turn)) for turn in ([0.0, 0.0, 0.8], [0.4, -0.3, 0.0]))
        robot = np.append([1.0, 2.0, 0.5], so3.product(yaw, tilt))
        prior = self.model.object_prior(self.detections[0], robot)
        np.testing.assert_allclose(so3.log(prior.mean[3:])[:2], 0.0, atol=1e-12)
        tilt, heading = np.sqrt(np.diagonal(prior.covariance))[[0, 2]]
        assert tilt == pytest.approx(0.02) and heading == pytest.approx(3.1)
        hanging = np.append(robot[:3], [1.0, 0.0, 0.0, 0.0])
        np.testing.assert_allclose(self.model.object_prior(self.detections[0], hanging).mean[3:], [0, 0, 0, 1])


class TestRayOfBodies(TestRangeAndRayOfBodies):
    """From a camera off the body's origin, without range."""

    detections = tuple(
        replace(own, range_m=np.nan, sensor=np.array([0.2, -0.1, 0.1])) for own in TestRangeAndRayOfPoints.detections
    )


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


def test_a_robot_anywhere_on_a_ring_about_a_landmark_is_not_steady() -> None:
    """However surely it sees that one ahead: what stands near it is seen from another side."""
    spaces, model = POSES_AND_POINTS_IN_SPACE, SpatialObservation()
    x, o = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]]), np.array([[2.0, 0.0, 0.0]])
    along_ring = np.array([0.0, 0.0, 1.8, 0.0, -3.6, 0.0, 0.0, 0.0, 0.0])  # turned by 1.8 rad about the landmark
    covariance, charts = np.outer(along_ring, along_ring)[None], np.eye(spaces.layout.size(1))[None]
    assert PointGeometry.bearing_sigma(model, x, o, covariance, charts) == pytest.approx(0.0, abs=1e-9)
    assert model.bearing_sigma(x, o, covariance, charts) == pytest.approx(1.8)


def test_one_point_deviates_from_one_ray_as_in_a_batch_to_the_last_bit() -> None:
    """Points anywhere, also on the ray, behind it and at the camera."""
    random = np.random.default_rng(3)
    for number, length in enumerate(np.tile([0.0, 1e-7, 1.0, 10.0], 50)):
        basis, _ = np.linalg.qr(random.normal(size=(3, 3)))
        ray, across = basis[:, 0], np.ascontiguousarray(basis[:, 1:])
        point = length * (random.choice([-1.0, 1.0]) * ray if number % 3 == 0 else random.normal(size=3))
        expected, slopes = polar_and_slopes(point, ray, across)
        found, by_point = deviation_and_slopes(point, ray, across)
        np.testing.assert_array_equal(found, expected[1:])
        np.testing.assert_array_equal(by_point, slopes[1:])
        np.testing.assert_array_equal(deviation(point, ray, across), polar(point, ray, across)[1:])
