"""The planar spaces, and the pairs of them that the engine knows, under their contracts."""

import numpy as np

from semantic_slam.contracts.state_space import SpacesContract, StateSpaceContract
from semantic_slam.inference.models.planar.point_observation import POSES_AND_POINTS
from semantic_slam.inference.states.planar_poses import PlanarPoses
from semantic_slam.inference.states.planar_positions import PlanarPositions
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


class TestPlanarPositions(StateSpaceContract):
    space = PlanarPositions()

    def states(self, random: np.random.Generator, count: int = 7) -> np.ndarray:
        return points(random, count)

    def point_in_map(self, state: np.ndarray, point: np.ndarray) -> np.ndarray:
        return state + point


class TestPosesAmongPoses(SpacesContract):
    spaces = Spaces.same(PlanarPoses())
    robots = landmarks = staticmethod(poses)

    def camera_from_landmark(self, x: np.ndarray, o: np.ndarray, sensor: np.ndarray) -> np.ndarray:
        return turned(-o[2], level(x) + turned(x[2], sensor) - level(o))


class TestPositionsAmongPositions(SpacesContract):
    spaces = Spaces.same(PlanarPositions())
    robots = landmarks = staticmethod(points)

    def camera_from_landmark(self, x: np.ndarray, o: np.ndarray, sensor: np.ndarray) -> np.ndarray:
        return level(x) + sensor - level(o)


class TestPosesAmongPoints(SpacesContract):
    spaces = POSES_AND_POINTS
    robots, landmarks = staticmethod(poses), staticmethod(points)

    def camera_from_landmark(self, x: np.ndarray, o: np.ndarray, sensor: np.ndarray) -> np.ndarray:
        return level(x) + turned(x[2], sensor) - level(o)


class TestPointsAmongPoses(SpacesContract):
    """Landmarks that are the larger ones."""

    spaces = Spaces(PlanarPositions(), PlanarPoses())
    robots, landmarks = staticmethod(points), staticmethod(poses)

    def camera_from_landmark(self, x: np.ndarray, o: np.ndarray, sensor: np.ndarray) -> np.ndarray:
        return turned(-o[2], level(x) + sensor - level(o))
