"""Views that a fit learns from are from where a run takes them to be: where the camera is."""

import numpy as np
from scipy.spatial.transform import Rotation

from semantic_slam.evaluation.seen_from import seen_from
from semantic_slam.geometry.pose import pose_vector_from_planar
from semantic_slam.inference.models.spatial.observation import POSES_AND_POINTS_IN_SPACE

RANDOM = np.random.default_rng(4)
PLACES, SENSORS = RANDOM.normal(size=(2, 20, 3))


def test_in_the_plane_heights_do_not_count():
    robots = RANDOM.normal(size=(20, 3))
    for robot, place, sensor in zip(robots, PLACES, SENSORS, strict=True):
        found = seen_from(pose_vector_from_planar(robot), place, sensor, in_space=False)
        turn = np.exp(1j * robot[2])
        offset = complex(*robot[:2]) + turn * complex(*sensor[:2]) - complex(*place[:2])
        np.testing.assert_allclose(found, [np.angle(offset), 0.0, abs(offset)], rtol=1e-12)


def test_in_space_the_distance_is_along_the_line_of_sight():
    turns = Rotation.random(20, random_state=5)
    poses = np.hstack([RANDOM.normal(size=(20, 3)), turns.as_quat()])
    found = [seen_from(*each, in_space=True) for each in zip(poses, PLACES, SENSORS, strict=True)]
    x, y, z = (poses[:, :3] + turns.apply(SENSORS) - PLACES).T
    expected = [np.arctan2(y, x), np.arctan2(z, np.hypot(x, y)), np.sqrt(x**2 + y**2 + z**2)]
    np.testing.assert_allclose(found, np.stack(expected, axis=1), rtol=1e-12)
    in_run = POSES_AND_POINTS_IN_SPACE.viewpoints(poses, PLACES, SENSORS)
    np.testing.assert_allclose(found, np.stack(list(vars(in_run).values()), axis=1), rtol=1e-12)
