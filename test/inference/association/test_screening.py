"""Partial associations: how their factors grow, and what one linear step tells of them."""

import numpy as np
import pytest
from worlds.exact.linear_gaussian import LinearDetection, LinearModel

from semantic_slam.inference.association.partial_assignments import PartialAssignments
from semantic_slam.inference.association.screening import ScreenedAssignments, screen
from semantic_slam.inference.evidence.keyframe_problem import KeyframeProblem, PredictedBelief
from semantic_slam.inference.evidence.laplace import Mode, find_modes
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.planar.observation import POSES_IN_PLANE, PlanarObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.states.kinds.planar_positions import PlanarPositions
from semantic_slam.inference.states.layout import Layout
from semantic_slam.inference.states.spaces import Spaces

GATE = 15.0
OBJECTS = np.array([[3.0, 1.0, 0.0], [3.0, -1.0, 1.0], [5.0, 0.5, -2.0]])
BEARING_RANGE = PlanarObservation(None, PlanarVisibility())


def of_prior(prefixes: PartialAssignments) -> Mode:
    count, size = prefixes.root.shape[:2]
    return Mode(np.zeros((count, size)), np.tile(np.eye(size), (count, 1, 1)), np.zeros(count))


def predicted(dimension: int, num_objects: int, scale: float = 1.0) -> PredictedBelief:
    """Two parents whose states hang together."""
    random = np.random.default_rng(1)
    size = (1 + num_objects) * dimension
    root = scale * random.normal(size=(2, size, size))
    mean = random.normal(size=(2, 1 + num_objects, dimension))
    return PredictedBelief(Layout(dimension, dimension), mean, root @ np.swapaxes(root, 1, 2) + scale**2 * np.eye(size))


@pytest.mark.parametrize("objects", [[0, 2, 1], [3, 3, 0], [2, 1, 2]])
def test_factors_grow_to_those_of_the_whole(objects: list[int]) -> None:
    """Also where a detection is of an object seen before."""
    gaussians = predicted(3, 4)
    prefixes = PartialAssignments.of_robots(POSES_IN_PLANE, gaussians)
    for number in objects:
        prefixes = prefixes.extended(np.arange(2), np.full(2, number))
    seen = BEARING_RANGE.collect([sighting(OBJECTS[0])] * 3)
    whole = KeyframeProblem.of(POSES_IN_PLANE, BEARING_RANGE, gaussians, seen, prefixes.rows)
    grown = prefixes.stack(BEARING_RANGE, seen)
    np.testing.assert_allclose(grown.root, whole.root, atol=1e-10)
    np.testing.assert_array_equal(grown.mean, whole.mean)
    own = np.concatenate([[0], [1 + n for i, n in enumerate(objects) if n not in objects[:i]]])
    used = np.concatenate([[True], [n not in objects[:i] for i, n in enumerate(objects)]])
    covariance = (prefixes.root @ prefixes.cross.reshape(2, prefixes.root.shape[1], -1)).reshape(2, 4, 3, 5, 3)
    np.testing.assert_allclose(covariance[:, used], gaussians.blocks[:, own], atol=1e-10)


def test_one_step_is_exact_for_linear_models() -> None:
    random = np.random.default_rng(0)
    model = LinearModel(np.array([[0.3, 0.1], [0.1, 0.2]]), np.eye(2), np.zeros((0, 2)), np.zeros((0, 2, 2)), 0)
    seen = model.collect([LinearDetection(random.normal(size=2), np.zeros(2)) for _ in range(2)])
    prefixes = PartialAssignments.of_robots(Spaces.same(PlanarPositions()), predicted(2, 3))
    first = screen(prefixes, of_prior(prefixes), *every(2, 3), model, seen.take(slice(1)), np.inf)
    second = screen(first.prefixes, first.mode, *every(6, 3), model, seen, np.inf)
    assert not len(first.searched) and not len(second.searched)
    found = find_modes(second.stack, np.zeros_like(second.mode.y))
    np.testing.assert_allclose(second.mode.y, found.y, atol=1e-8)
    np.testing.assert_allclose(second.mode.hessian, found.hessian, atol=1e-8)
    np.testing.assert_allclose(second.mode.log_evidence, found.log_evidence, atol=1e-8)


def test_a_tracked_robot_is_ranked_by_one_step() -> None:
    screened, found = looked_at(sigma_m=0.1, sigma_rad=0.02)
    assert not len(screened.searched)
    near = found.log_evidence > found.log_evidence.max() - 5.0
    assert near.any()
    np.testing.assert_allclose(screened.mode.log_evidence[near], found.log_evidence[near], atol=0.1)


def test_a_lost_robot_is_searched_for() -> None:
    screened, _ = looked_at(sigma_m=10.0, sigma_rad=0.5)
    assert len(screened.searched) == len(OBJECTS)


def test_a_long_step_is_not_trusted() -> None:
    """However small the spread: one step may be off by as many nats as it is long."""
    screened, _ = looked_at(sigma_m=0.1, sigma_rad=0.02, gate=np.inf)
    objects = screened.prefixes.rows.objects[screened.searched, 0]
    assert objects.tolist() == [1, 2]


def test_what_nothing_follows_needs_no_cross_covariance() -> None:
    """It is the largest array of all where many candidates are lost."""
    screened, _ = looked_at(sigma_m=10.0, sigma_rad=0.5)
    assert "cross" not in vars(screened.prefixes)


def test_what_is_far_off_is_dropped_and_counted() -> None:
    """As many nats behind as its linear evidence."""
    screened, _ = looked_at(sigma_m=0.1, sigma_rad=0.02, gate=5.0)
    everything, _ = looked_at(sigma_m=0.1, sigma_rad=0.02, gate=np.inf)
    evidence = everything.mode.log_evidence
    behind = evidence - evidence.max()
    kept = screened.prefixes.rows.objects[:, 0]
    np.testing.assert_array_equal(kept, np.flatnonzero(behind >= -10.0))
    assert 0 < len(kept) < len(OBJECTS)
    assert screened.log_left_out[0] == pytest.approx(np.logaddexp.reduce(np.delete(behind, kept)))


def sighting(place: np.ndarray) -> PlanarDetection:
    """From the origin, nothing amiss."""
    distance, bearing = float(np.hypot(*place[:2])), float(np.arctan2(place[1], place[0]))
    return PlanarDetection(
        range_m=distance,
        bearing_rad=bearing,
        covariance=np.diag([0.1, 0.02]) ** 2,
        sensor=np.zeros(2),
        feature=np.zeros(0),
        feature_covariance=np.zeros((0, 0)),
    )


def every(count: int, num_objects: int) -> tuple[np.ndarray, np.ndarray]:
    """Each of the prefixes with each object."""
    return np.repeat(np.arange(count), num_objects), np.tile(np.arange(num_objects), count)


def looked_at(sigma_m: float, sigma_rad: float, gate: float = GATE) -> tuple[ScreenedAssignments, Mode]:
    """The first detection, of the first object, and the modes that a search finds."""
    spread = np.diag([sigma_m, sigma_m, sigma_rad, *[0.1, 0.1, 0.1] * len(OBJECTS)]) ** 2
    gaussians = PredictedBelief(POSES_IN_PLANE.layout, np.concatenate([np.zeros((1, 3)), OBJECTS])[None], spread[None])
    prefixes = PartialAssignments.of_robots(POSES_IN_PLANE, gaussians)
    seen = BEARING_RANGE.collect([sighting(OBJECTS[0])])
    screened = screen(prefixes, of_prior(prefixes), *every(1, len(OBJECTS)), BEARING_RANGE, seen, gate)
    return screened, find_modes(screened.stack, screened.mode.y)
