"""Chapter 4's weights in the benchmark: reference, sampler and engine are three ways to one posterior."""

from collections.abc import Callable

import numpy as np
import pytest
from semantic_slam_lab.benchmarks import weights_accuracy, weights_time
from semantic_slam_lab.benchmarks.weights_reference import reference_posterior, total_variation
from semantic_slam_lab.grid.world import Noise, World, grid_world
from semantic_slam_lab.peers.literal_alg_4_1 import LiteralWeights
from semantic_slam_lab.peers.prior_samples import Gaussian, candidates_of, separate_weights, shared_weights

FEW = 2**14
Sampler = Callable[[World, Gaussian, np.random.Generator, int], np.ndarray]
KNOWN_START = Noise(robot=(0.25, 0.25, 0.01))


def _batches(world: World, sampler: Sampler, seed: int, count: int = 40, num_samples: int = 5000) -> np.ndarray:
    """(count, B) independent estimates of psi."""
    random = np.random.default_rng(seed)
    return np.array([sampler(world, world.predicted_robot(), random, num_samples) for _ in range(count)])


def _agree(first: np.ndarray, second: np.ndarray) -> None:
    """Means of two sets of estimates within five standard errors of each other, in all likely candidates."""
    difference = first.mean(axis=0) - second.mean(axis=0)
    variance = first.var(axis=0, ddof=1) / len(first) + second.var(axis=0, ddof=1) / len(second)
    likely = second.mean(axis=0) > 0.01 * second.mean(axis=0).max()
    assert likely.any() and (np.abs(difference) < 5.0 * np.sqrt(variance))[likely].all()


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 3])
def test_the_reference_is_what_samples_from_the_prior_tend_to(seed: int) -> None:
    world = grid_world(seed, num_detections=2, noise=KNOWN_START)
    reference = reference_posterior(world, seed, FEW)
    psi = _batches(world, shared_weights, seed).reshape(40, len(reference.associations), -1).sum(axis=-1)
    found = psi / psi.sum(axis=1, keepdims=True)
    scatter = found.std(axis=0, ddof=1) / np.sqrt(len(found))
    assert (np.abs(found.mean(axis=0) - reference.probabilities) < 5.0 * scatter + 5e-4).all()
    assert reference.error < 3e-3 and 0.05 < reference.probabilities.max() < 0.9999


@pytest.mark.slow
def test_samples_shared_by_associations_and_samples_of_their_own_have_one_mean() -> None:
    world = grid_world(1, num_detections=2, noise=KNOWN_START)
    shared, separate = (_batches(world, each, 1, 20, 2000) for each in (shared_weights, separate_weights))
    _agree(separate, shared)


@pytest.mark.slow
def test_the_printed_loop_has_the_mean_of_the_vectorised_samples() -> None:
    world = grid_world(1, num_detections=2, noise=KNOWN_START)
    vectorised = _batches(world, shared_weights, 2)
    objects, classes = candidates_of(2, 6)
    likely = np.argsort(-vectorised.mean(axis=0))[:3]
    literal = LiteralWeights(world, world.predicted_robot(), np.random.default_rng(3), 300)
    looped = np.array([[literal.weight(objects[i], classes[i]) for i in likely] for _ in range(8)])
    _agree(looped, vectorised[:, likely])


@pytest.mark.slow
@pytest.mark.parametrize("aligned", [False, True])
def test_the_engine_agrees_with_the_reference_where_the_sampler_does_not(aligned: bool) -> None:
    found = [weights_accuracy.errors(seed, aligned, FEW) for seed in range(3)]
    assert np.median([errors.candidates for errors in found]) < 0.03
    assert np.median([errors.thesis for errors in found]) > 0.1
    for errors in found:
        assert errors.belief < errors.candidates + errors.discarded + 1e-3
        assert errors.reference.error < 5e-3


@pytest.mark.slow
def test_accuracy_rows_are_named_and_finite(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(weights_accuracy, "QUICK_SEEDS", 1)
    monkeypatch.setattr(weights_accuracy, "NUM_REFERENCE_SAMPLES", FEW)
    monkeypatch.setattr(weights_accuracy, "MOST_JOBS", 1)
    rows = {row.name: row for row in weights_accuracy.accuracy(quick=True, seed=0)}
    assert len(rows) == 8 and "weights_total_variation_median" in rows and "belief_total_variation_p90_aligned" in rows
    assert all(np.isfinite([row.ours, row.peer, row.ratio]).all() and row.n == 1 for row in rows.values())


def test_total_variation_of_disjoint_and_equal_distributions() -> None:
    assert total_variation(np.array([1.0, 0.0]), np.array([0.0, 1.0])) == 1.0
    assert total_variation(np.array([0.3, 0.7]), np.array([0.3, 0.7])) == 0.0


def test_time_rows_of_the_weights(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in (("PARENTS", 2), ("QUICK_REPETITIONS", 1), ("LITERAL_CANDIDATES", 1)):
        monkeypatch.setattr(weights_time, name, value)
    rows = {row.name: row for row in weights_time.weights(quick=True, seed=0)}
    assert list(rows) == ["weights_vs_literal", "weights_vs_sampled", "weights_vs_shared_samples"]
    assert all(row.ours > 0.0 and row.ratio == pytest.approx(row.peer / row.ours) for row in rows.values())
    assert rows["weights_vs_literal"].peer > rows["weights_vs_sampled"].peer > rows["weights_vs_shared_samples"].peer
