"""Gates and joint assignments against enumeration, and one linearisation against the exact Gaussian."""

from itertools import product

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from worlds.exact.linear_gaussian import LinearDetection, LinearModel

from semantic_slam.inference.association.gating import best_assignments, pair_densities
from semantic_slam.inference.association.sums import clusters, log_sum_of_all
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.evidence.keyframe_problem import PredictedBelief
from semantic_slam.inference.open_world.joint.linear_evidence import LinearisedEvidence
from semantic_slam.inference.states.kinds.planar_positions import PlanarPositions
from semantic_slam.inference.states.spaces import Spaces


def everything(log_known: np.ndarray, log_new: np.ndarray) -> list[tuple[float, tuple[int, ...]]]:
    """All assignments of distinct objects, best first."""
    count, known = log_known.shape
    table = np.concatenate([log_known, np.full((count, count), -np.inf)], axis=1)
    table[np.arange(count), known + np.arange(count)] = log_new
    options = product(*(np.flatnonzero(np.isfinite(row)) for row in table))
    distinct = [own for own in options if len(set(own)) == count]
    return sorted(((float(table[range(count), list(own)].sum()), own) for own in distinct), reverse=True)


@pytest.mark.parametrize("seed", range(8))
def test_the_sum_over_all_assignments_is_exact(seed: int) -> None:
    random = np.random.default_rng(seed)
    count, known = int(random.integers(0, 5)), int(random.integers(0, 5))
    log_known, log_new = random.normal(size=(count, known)) * 3.0, random.normal(size=count)
    total = np.logaddexp.reduce([score for score, _ in everything(log_known, log_new)])
    assert log_sum_of_all(log_known, log_new) == pytest.approx(total, rel=1e-12, abs=1e-12)


def test_the_sum_is_exact_for_many_detections_that_fall_into_clusters() -> None:
    """Five clusters of three detections each, which no set of fifteen has to be looked at for."""
    random = np.random.default_rng(1)
    parts = [(random.normal(size=(3, 2)), random.normal(size=3)) for _ in range(5)]
    log_known = np.full((15, 10), -np.inf)
    for number, (own, _) in enumerate(parts):
        log_known[3 * number : 3 * number + 3, 2 * number : 2 * number + 2] = own
    order = random.permutation(15)
    total = sum(np.logaddexp.reduce([score for score, _ in everything(*part)]) for part in parts)
    found = log_sum_of_all(log_known[order], np.concatenate([new for _, new in parts])[order])
    assert found == pytest.approx(total, abs=1e-10)


@pytest.mark.parametrize("share", [0.02, 0.1, 0.4])
@pytest.mark.parametrize("shape", [(1, 1), (3, 0), (8, 5), (30, 40)])
def test_clusters_are_the_connected_parts_of_the_graph(shape: tuple[int, int], share: float) -> None:
    """Detections that a chain of others links stand in one, in the order of their first ones."""
    random = np.random.default_rng(5)
    known = np.where(random.random(shape) < share, random.random(shape), 0.0)
    rows, columns = np.nonzero(known)
    links = coo_array((np.ones(len(rows)), (rows, shape[0] + columns)), shape=(sum(shape),) * 2)
    _, labels = connected_components(links, directed=False)
    found = [(own.tolist(), (shape[0] + objects).tolist()) for own, objects in clusters(known)]
    first = dict.fromkeys(labels[: shape[0]].tolist())
    assert [own + objects for own, objects in found] == [np.flatnonzero(labels == label).tolist() for label in first]


@pytest.mark.parametrize("limit", [1, 5, 1000])
def test_what_is_enumerated_and_what_is_left_out_add_up(limit: int) -> None:
    random = np.random.default_rng(3)
    log_known, log_new = random.normal(size=(3, 4)) * 2.0, random.normal(size=3)
    expected = everything(log_known, log_new)
    chosen = best_assignments(log_known, np.ones((3, 4), dtype=bool), log_new, limit, np.inf)
    assert [tuple(row) for row in chosen.columns] == [tuple(int(n) for n in own) for _, own in expected[:limit]]
    total = np.logaddexp.reduce([score for score, _ in expected])
    left_out = chosen.log_left_out + chosen.log_scores[0]
    assert np.logaddexp(np.logaddexp.reduce(chosen.log_scores), left_out) == pytest.approx(total)
    assert (limit == 1000) == np.isneginf(chosen.log_left_out)


def test_pairs_outside_the_gate_and_bad_assignments_count_as_left_out() -> None:
    log_known, log_new = np.array([[0.0, -1.0]]), np.array([-30.0])
    chosen = best_assignments(log_known, np.array([[True, False]]), log_new, 10, 5.0)
    assert chosen.columns.tolist() == [[0]]
    assert np.exp(chosen.log_left_out) == pytest.approx(np.exp(-1.0) + np.exp(-30.0))


def test_no_detections_have_one_assignment() -> None:
    chosen = best_assignments(np.zeros((0, 3)), np.zeros((0, 3), dtype=bool), np.zeros(0), 10, 5.0)
    assert chosen.columns.shape == (1, 0)
    assert np.isneginf(chosen.log_left_out)


def test_one_linearisation_is_exact_for_a_linear_problem() -> None:
    """z = o - x + noise: p(z1, z2) is normal with covariance J P J' + I / 4, the posterior follows by conditioning."""
    random = np.random.default_rng(0)
    mean = random.normal(size=(3, 2))
    root = random.normal(size=(6, 6))
    covariance = root @ root.T + np.eye(6)
    offsets = [mean[1] - mean[0] + 0.3, mean[2] - mean[0] - 0.8]
    detections = [LinearDetection(offset, np.zeros(2)) for offset in offsets]
    model = LinearModel(0.25 * np.eye(2), np.eye(2), np.zeros((0, 2)), np.zeros((0, 2, 2)), 0)
    spaces = Spaces.same(PlanarPositions())
    pairs = pair_densities(spaces, model, detections, PredictedBelief(spaces.layout, mean[None], covariance[None]))
    linear = LinearisedEvidence(spaces, mean, covariance, pairs, [], np.zeros(2))
    columns = np.array([[0, 1], [1, 0]])
    result = linear.evaluate(Assignments(parents=np.zeros(2, dtype=int), objects=columns), columns)
    for row, (first, second) in enumerate([(1, 2), (2, 1)]):
        jacobian = np.zeros((4, 6))
        jacobian[:, :2] = np.tile(-np.eye(2), (2, 1))
        jacobian[:2, 2 * first : 2 * first + 2] = jacobian[2:, 2 * second : 2 * second + 2] = np.eye(2)
        spread = jacobian @ covariance @ jacobian.T + 0.25 * np.eye(4)
        innovation = np.concatenate(offsets) - jacobian @ mean.ravel()
        expected = -0.5 * innovation @ np.linalg.solve(spread, innovation)
        expected -= 0.5 * np.linalg.slogdet(2.0 * np.pi * spread)[1]
        assert result.log_evidence[row] == pytest.approx(expected)
        gain = covariance @ jacobian.T @ np.linalg.inv(spread)
        np.testing.assert_allclose(result.robot[row], mean[0] + (gain @ innovation)[:2])
        after = covariance - gain @ jacobian @ covariance
        np.testing.assert_allclose(result.robot_covariance[row], after[:2, :2])
        own = slice(2 * first, 2 * first + 2)
        np.testing.assert_allclose(result.object_covariances[row, 0], after[own, own])
        np.testing.assert_allclose(result.object_crosses[row, 0], after[:2, own])
        if row == 0:
            assert pairs.log_density[0, 0] == pytest.approx(_single(mean, covariance, offsets[0], 1))


def _single(mean: np.ndarray, covariance: np.ndarray, offset: np.ndarray, number: int) -> float:
    jacobian = np.zeros((2, 6))
    jacobian[:, :2], jacobian[:, 2 * number : 2 * number + 2] = -np.eye(2), np.eye(2)
    spread = jacobian @ covariance @ jacobian.T + 0.25 * np.eye(2)
    innovation = offset - jacobian @ mean.ravel()
    return float(
        -0.5 * innovation @ np.linalg.solve(spread, innovation) - 0.5 * np.linalg.slogdet(2 * np.pi * spread)[1]
    )
