"""A camera that is lost among objects that look alike: places repeat, and the sides that it sees tell where it is."""

import numpy as np
import pytest
from worlds.exact.spatial_fixtures import NAMES, spatial
from worlds.scenes.flights import Flight

from semantic_slam import Engine, MapPrior, ObjectPrior
from semantic_slam.geometry import se3, so3
from semantic_slam.inference.states.spaces import viewpoints_of
from semantic_slam.viewpoint.parametric import ParametricModel

ROOMS, KEYFRAMES = 10, 10
LOST_M, ANY_YAW = 3.0, 1.8
"""Standard deviations before the first keyframe, of the position and of the heading; gravity is known."""
CORNERS, RADIUS_M, HEIGHT_M = 7, 2.2, 0.8
"""Of objects at the corners of a regular polygon: turned by a corner, geometry is the same."""
ALPHA, CONCENTRATION = 0.9, 15.0
MODEL = ParametricModel(ALPHA, CONCENTRATION, NAMES)
SEMANTIC = {"kind": "parametric", "alpha": ALPHA, "concentration": CONCENTRATION, "class_names": list(NAMES)}


class Looking(Flight):
    """A camera that tells what it sees of objects: their classes' scores, by where it looks from."""

    def __init__(self, random: np.random.Generator, poses: np.ndarray, classes: np.ndarray, start: np.ndarray) -> None:
        super().__init__(random, poses[:, :3], start)
        self.poses, self.classes = poses, classes

    def scores(self, number: int) -> dict[str, float]:
        camera = se3.between(self.poses[number], self.x)[None, :3]
        from_here = viewpoints_of(camera)
        expected = MODEL.predict(self.classes[number : number + 1], from_here)
        noise = np.linalg.cholesky(expected.covariance[0]) @ self.random.normal(size=2)
        return dict(zip(NAMES, expected.mean[0] + noise, strict=True))


def lost(seed: int, *, semantics: bool) -> tuple[float, float]:
    """Error [m] and weight of the best hypothesis after some keyframes in a room that looks alike from every corner.

    The map knows how objects are turned, and not of which of two classes they are.
    """
    random = np.random.default_rng(seed)
    angles = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
    turns = np.zeros((CORNERS, 3))
    turns[:, 2] = random.uniform(-np.pi, np.pi, CORNERS)
    places = np.stack([RADIUS_M * np.cos(angles), RADIUS_M * np.sin(angles), np.full(CORNERS, HEIGHT_M)], axis=1)
    poses, classes = np.column_stack([places, so3.exp(turns)]), random.integers(0, 2, CORNERS)
    yaws = np.zeros((2, 3))
    yaws[:, 2] = random.uniform(-3.0, 3.0, 2)
    start = np.append(random.uniform([-0.3, -0.3, 0.8], [0.3, 0.3, 1.4]), so3.exp(yaws[0]))
    guess = np.append(start[:3] + LOST_M * random.normal(size=3), so3.exp(yaws[1]))
    sigma = np.array([0.05, 0.05, 0.05, 0.0, 0.0, 0.1])
    known = (
        ObjectPrior(object_id=n, name=str(n), pose=pose, covariance=np.diag(sigma**2), class_probabilities={})
        for n, pose in enumerate(poses)
    )
    engine = Engine(
        spatial(
            observation="range_bearing",
            semantic_model=SEMANTIC if semantics else {"kind": "none"},
            weights={"importance_samples": 256},
            pruning={},
        ),
        MapPrior(tuple(known)),
        initial_pose=guess,
        initial_covariance=np.diag([LOST_M, LOST_M, LOST_M, 0.01, 0.01, ANY_YAW]) ** 2,
    )
    flight = Looking(random, poses, classes, start)
    for _ in range(KEYFRAMES):
        belief = flight.fly(engine, 3, named=False)
    return float(np.linalg.norm(belief.poses[0, :3] - flight.x[:3])), float(np.exp(belief.log_weights[0]))


@pytest.mark.long
def test_a_lost_camera_is_settled_right_by_the_sides_that_it_sees() -> None:
    """In nine of ten rooms at least."""
    found = [lost(seed, semantics=True) for seed in range(ROOMS)]
    assert sum(error < 0.3 and weight > 0.5 for error, weight in found) >= 9, found


@pytest.mark.long
def test_by_geometry_alone_it_remains_lost() -> None:
    found = [lost(seed, semantics=False) for seed in range(3)]
    assert all(weight < 0.5 for _, weight in found), found
