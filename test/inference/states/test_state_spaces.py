"""The state spaces, and the pairs of them that the engine knows, under their contracts."""

import gtsam
import numpy as np

from semantic_slam.contracts.state_space import COUNT, SpacesContract, StateSpaceContract
from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.pose import pose_vector_from_planar
from semantic_slam.inference.models.planar.observation import POSES_IN_PLANE
from semantic_slam.inference.models.planar.point_observation import POSES_AND_POINTS
from semantic_slam.inference.models.spatial.views import POSES_IN_SPACE
from semantic_slam.inference.states.kinds.planar_objects import PlanarObjects
from semantic_slam.inference.states.kinds.planar_poses import PlanarPoses
from semantic_slam.inference.states.kinds.planar_positions import PlanarPositions
from semantic_slam.inference.states.kinds.spatial_objects import SpatialObjects
from semantic_slam.inference.states.kinds.spatial_poses import SpatialPoses
from semantic_slam.inference.states.kinds.spatial_positions import SpatialPositions
from semantic_slam.inference.states.spaces import Spaces


def poses(random: np.random.Generator, count: int) -> np.ndarray:
    return random.uniform([-4.0, -4.0, -np.pi], [4.0, 4.0, np.pi], (count, 3))


def points(random: np.random.Generator, count: int) -> np.ndarray:
    return random.uniform(-4.0, 4.0, (count, 2))


def turned(angle: float, vector: np.ndarray) -> np.ndarray:
    """A vector's first two components turned by an angle; its height stays."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], *vector[2:]])


def level(point: np.ndarray) -> np.ndarray:
    return np.array([*point[:2], 0.0])


class TestPlanarPoses(StateSpaceContract):
    space = PlanarPoses()

    def states(self, random: np.random.Generator, count: int = 7) -> np.ndarray:
        return poses(random, count)

    def point_in_map(self, state: np.ndarray, point: np.ndarray) -> np.ndarray:
        return state[:2] + turned(state[2], point)


class TestPlanarObjects(TestPlanarPoses):
    space = PlanarObjects()
    largest_propagated = 1e-6

    def test_a_turn_does_not_bend_a_shift(self, random: np.random.Generator) -> None:
        x, t = self.states(random), self.tangents(random)
        shifted = t * [1.0, 1.0, 0.0]
        np.testing.assert_allclose(self.space.retract(x, t)[:, :2], self.space.retract(x, shifted)[:, :2], atol=1e-12)

    def test_the_prior_s_factors_are_the_gaussian_of_position_and_heading(self, random: np.random.Generator) -> None:
        """Far from the mean, too: three radians off, half a metre aside."""
        mean, at = np.array([0.3, -2.0, 0.7]), np.array([0.8, -1.9, -2.6])
        spread = np.array([[0.09, 0.03, 0.0], [0.03, 0.04, 0.0], [0.0, 0.0, 9.0]])
        values = gtsam.Values()
        self.space.insert(values, 0, at)
        off = np.append(turned(-mean[2], (at - mean)[:2]), at[2] - mean[2] + 2.0 * np.pi * (at[2] - mean[2] < -np.pi))
        factors = self.space.prior_factors(0, mean, spread)
        expected = 0.5 * off @ np.linalg.solve(spread, off)
        assert abs(sum(factor.error(values) for factor in factors) - expected) < 1e-9


class TestPlanarPositions(StateSpaceContract):
    space = PlanarPositions()

    def states(self, random: np.random.Generator, count: int = 7) -> np.ndarray:
        return points(random, count)

    def point_in_map(self, state: np.ndarray, point: np.ndarray) -> np.ndarray:
        return state + point


class PlanarSpacesContract(SpacesContract):
    """What is so in the plane alone."""

    def test_a_camera_without_height_is_level(self, random: np.random.Generator) -> None:
        x, o = self.pairs(random)
        flat, level = (self.spaces.viewpoints(x, o, np.array(s)) for s in ([0.3, 0.1], [0.3, 0.1, 0.0]))
        np.testing.assert_array_equal(flat.azimuth_rad, level.azimuth_rad)
        np.testing.assert_array_equal(flat.elevation_rad, np.zeros(COUNT))


class TestPosesAmongPoses(PlanarSpacesContract):
    spaces = Spaces.same(PlanarPoses())
    robots = landmarks = staticmethod(poses)

    def camera_from_landmark(self, x: np.ndarray, o: np.ndarray, sensor: np.ndarray) -> np.ndarray:
        return turned(-o[2], level(x) + turned(x[2], sensor) - level(o))


class TestPosesAmongObjects(TestPosesAmongPoses):
    """Their own arithmetic for robot and objects at once, by which rows of both kinds are moved."""

    spaces = POSES_IN_PLANE


class TestPositionsAmongPositions(PlanarSpacesContract):
    spaces = Spaces.same(PlanarPositions())
    robots = landmarks = staticmethod(points)

    def camera_from_landmark(self, x: np.ndarray, o: np.ndarray, sensor: np.ndarray) -> np.ndarray:
        return level(x) + sensor - level(o)


class TestPosesAmongPoints(PlanarSpacesContract):
    spaces = POSES_AND_POINTS
    robots, landmarks = staticmethod(poses), staticmethod(points)

    def camera_from_landmark(self, x: np.ndarray, o: np.ndarray, sensor: np.ndarray) -> np.ndarray:
        return level(x) + turned(x[2], sensor) - level(o)


class TestPointsAmongPoses(PlanarSpacesContract):
    """Landmarks that are the larger ones."""

    spaces = Spaces(PlanarPositions(), PlanarPoses())
    robots, landmarks = staticmethod(points), staticmethod(poses)

    def camera_from_landmark(self, x: np.ndarray, o: np.ndarray, sensor: np.ndarray) -> np.ndarray:
        return turned(-o[2], level(x) + sensor - level(o))


# In space.


def spatial_poses(random: np.random.Generator, count: int) -> np.ndarray:
    axes = random.normal(size=(count, 3))
    turns = axes / np.linalg.norm(axes, axis=1, keepdims=True) * random.uniform(0.0, np.pi, (count, 1))
    return np.concatenate([random.uniform(-4.0, 4.0, (count, 3)), so3.exp(turns)], axis=1)


def places(random: np.random.Generator, count: int) -> np.ndarray:
    return random.uniform(-4.0, 4.0, (count, 3))


def rotation(state: np.ndarray) -> np.ndarray:
    return gtsam.Rot3.Quaternion(state[6], *state[3:6]).matrix()


class TestSpatialPoses(StateSpaceContract):
    space = SpatialPoses()

    def states(self, random: np.random.Generator, count: int = 7) -> np.ndarray:
        return spatial_poses(random, count)

    def point_in_map(self, state: np.ndarray, point: np.ndarray) -> np.ndarray:
        return state[:3] + rotation(state) @ point


class TestSpatialObjects(TestSpatialPoses):
    space = SpatialObjects()
    largest_propagated = 1e-6

    def test_a_turn_does_not_bend_a_shift(self, random: np.random.Generator) -> None:
        x, t = self.states(random), self.tangents(random)
        shifted = t * np.repeat([0.0, 1.0], 3)
        np.testing.assert_allclose(self.space.retract(x, t)[:, :3], self.space.retract(x, shifted)[:, :3], atol=1e-12)

    def test_the_prior_s_factors_are_the_gaussian_of_position_and_attitude(self, random: np.random.Generator) -> None:
        mean, off = self.states(random, 1)[0], np.array([0.2, -0.4, 2.0, 0.5, 0.1, -0.3])
        root = random.normal(size=(2, 3, 3))
        spread = np.zeros((6, 6))
        spread[:3, :3], spread[3:, 3:] = root @ np.swapaxes(root, 1, 2) + np.eye(3)
        values = gtsam.Values()
        self.space.insert(values, 0, self.space.retract(mean, off))
        error = sum(factor.error(values) for factor in self.space.prior_factors(0, mean, spread))
        assert abs(error - 0.5 * off @ np.linalg.solve(spread, off)) < 1e-6


class TestSpatialPositions(StateSpaceContract):
    space = SpatialPositions()

    def states(self, random: np.random.Generator, count: int = 7) -> np.ndarray:
        return places(random, count)

    def point_in_map(self, state: np.ndarray, point: np.ndarray) -> np.ndarray:
        return state + point


class TestSpatialPosesAmongPoints(SpacesContract):
    spaces = Spaces(SpatialPoses(), SpatialPositions())
    robots, landmarks = staticmethod(spatial_poses), staticmethod(places)

    def camera_from_landmark(self, x: np.ndarray, o: np.ndarray, sensor: np.ndarray) -> np.ndarray:
        return x[:3] + rotation(x) @ sensor - o


class TestSpatialPosesAmongPoses(SpacesContract):
    spaces = Spaces.same(SpatialPoses())
    robots = landmarks = staticmethod(spatial_poses)

    def camera_from_landmark(self, x: np.ndarray, o: np.ndarray, sensor: np.ndarray) -> np.ndarray:
        return rotation(o).T @ (x[:3] + rotation(x) @ sensor - o[:3])


class TestSpatialPosesAmongObjects(TestSpatialPosesAmongPoses):
    spaces = POSES_IN_SPACE


def test_a_pose_in_the_plane_moves_in_space_as_in_the_plane() -> None:
    """Compositions, steps, their slopes and covariances, row by row: x, y and yaw are rows 3, 4 and 2 of a tangent."""
    random, plane, space = np.random.default_rng(1), PlanarPoses(), SpatialPoses()
    x, u, t = poses(random, 5), poses(random, 5), random.normal(size=(5, 3))
    lifted, rows = pose_vector_from_planar(x), [3, 4, 2]
    tangent = np.zeros((5, 6))
    tangent[:, rows] = t
    for flat, own in (
        (plane.compose(x, u), space.compose(lifted, pose_vector_from_planar(u))),
        (plane.retract(x, t), space.retract(lifted, tangent)),
    ):
        np.testing.assert_allclose(se3.log(se3.between(pose_vector_from_planar(flat), own)), 0.0, atol=1e-12)
    spread = np.tile(np.diag([0.1, 0.2, 0.3]) + 0.05, (5, 1, 1))
    wide = np.zeros((5, 6, 6))
    wide[np.ix_(range(5), rows, rows)] = spread
    np.testing.assert_allclose(space.covariances(lifted, wide), plane.covariances(x, spread), atol=1e-12)
    moves = space.propagation(pose_vector_from_planar(u))[np.ix_(range(5), rows, rows)]
    np.testing.assert_allclose(moves, plane.propagation(u), atol=1e-12)
    chart = space.exp_and_jacobian(tangent)[1][np.ix_(range(5), rows, rows)]
    np.testing.assert_allclose(chart, plane.exp_and_jacobian(t)[1], atol=1e-12)
