"""Whether a belief in space explains its data: no alarm under the right model, and one where the robot was carried."""

from collections.abc import Callable

import numpy as np
import pytest
from worlds.exact.spatial_fixtures import spatial
from worlds.scenes.flights import DRIFT, HALF_VIEW_RAD, Flight

from semantic_slam import Engine, Keyframe, MapPrior, ObjectPrior
from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.evidence.model_fit import WINDOW_KEYFRAMES

SEEDS, KEYFRAMES, FAULT = range(3), 12, 6
START = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
SIGMAS = np.array([0.02, 0.02, 0.05, 0.05, 0.05, 0.05])
FEWER = {"weights": {"importance_samples": 256}, "pruning": {}}
IN_SIGHT = 3
OPEN_WORLD = {
    "open_world": {
        "field_of_view_rad": 2.0 * HALF_VIEW_RAD,
        "vertical_field_of_view_rad": 2.0 * HALF_VIEW_RAD,
        "min_range_m": 0.1,
        "max_range_m": 6.0,
        "detection_probabilities": [0.3, 0.6, 0.9],
        "birth_density": 0.1,
    }
}


def flown(seed: int, change: Callable[[Flight, int], None], *, association: str) -> Array:
    """(K,) ``unexplained`` of a flight among ten points that ``change`` may disturb before each keyframe."""
    random = np.random.default_rng(seed)
    points = random.uniform([-2.5, -2.5, 0.0], [2.5, 2.5, 2.0], (10, 3))
    known = MapPrior(tuple(ObjectPrior.point(n, place, sigma_m=0.05) for n, place in enumerate(points)))
    engine = Engine(
        spatial(association=association, **FEWER, **OPEN_WORLD),
        known if association == "enumerated" else None,
        initial_pose=START,
        initial_covariance=se3.covariance_along_parent(START, np.diag(SIGMAS**2)),
    )
    flight, found = Flight(random, points, se3.retract(START, random.normal(size=6) * SIGMAS)), []
    for k in range(KEYFRAMES):
        change(flight, k)
        most = len(points) if association == "open" else IN_SIGHT
        found.append(flight.fly(engine, most, named=association == "given").unexplained)
    return np.array(found)


def nothing(flight: Flight, k: int) -> None:
    """The model holds."""


def carried(flight: Flight, k: int) -> None:
    """Two metres, and a half turn about the vertical, before one keyframe."""
    if k == FAULT:
        turn = so3.exp(np.array([0.0, 0.0, np.pi]))
        flight.x = np.append(flight.x[:3] + np.array([1.4, -1.4, 0.0]), so3.product(turn, flight.x[3:]))


@pytest.mark.long
@pytest.mark.parametrize(("association", "most"), [("enumerated", 0.01), ("given", 0.01), ("open", 0.5)])
def test_a_right_model_raises_no_alarm(association: str, most: float) -> None:
    for seed in SEEDS:
        assert flown(seed, nothing, association=association).max() < most


@pytest.mark.long
@pytest.mark.parametrize("association", ["enumerated", "given"])
def test_a_camera_that_is_carried_is_told_within_two_keyframes(association: str) -> None:
    for seed in SEEDS:
        found = flown(seed, carried, association=association)
        assert found[:FAULT].max() < 0.01 and found[FAULT : FAULT + 2].max() > 0.99


def levelled(*, measures: bool) -> Array:
    """(K,) ratios of both models' evidence for a camera that sees nothing, and may measure gravity, not quite right."""
    random, x = np.random.default_rng(0), START
    spread = se3.covariance_along_parent(START, np.diag(SIGMAS**2))
    world = OPEN_WORLD["open_world"] | {"least_undetected_share": 1.0}  # expected births do not depend on the pose
    configuration = spatial(association="open", **FEWER, open_world=world)
    engine = Engine(configuration, initial_pose=START, initial_covariance=spread)
    for k in range(WINDOW_KEYFRAMES):
        motion = se3.exp(np.array([0.1, -0.1, 0.3, 0.2, 0.0, 0.0]))
        x = se3.retract(se3.compose(x, motion), random.normal(size=6) * DRIFT)
        up = so3.matrix(x[3:])[2] + 0.02 * random.normal(size=3)
        covariance = np.diag(DRIFT**2)[se3.TO_MESSAGE][:, se3.TO_MESSAGE]
        keyframe = Keyframe.spatial(k, motion=motion, motion_covariance=covariance, up=up if measures else None)
        engine.process(keyframe)
    return np.array(engine.model_fit.lately)


def test_gravity_says_nothing_of_whether_detections_are_explained() -> None:
    """But for linearisation: the density of a measurement of gravity alone is some six nats."""
    np.testing.assert_allclose(levelled(measures=True), levelled(measures=False), atol=0.05)
