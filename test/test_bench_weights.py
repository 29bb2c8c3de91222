"""Chapter 4's weights in the benchmark: reference, sampler and engine are three ways to one posterior."""

import numpy as np
import pytest

from semantic_slam.benchmarks import weights_accuracy
from semantic_slam.benchmarks.grid_world import Noise, World, grid_world
from semantic_slam.benchmarks.prior_samples import candidates_of, sampled_weights
from semantic_slam.benchmarks.weights_reference import reference_posterior, total_variation

FEW = 2**14
KNOWN_START = Noise(robot=(0.25, 0.25, 0.01))


def _sampled(world: World, associations: np.ndarray, num_samples: int, seed: int) -> np.ndarray:
    objects, classes = candidates_of(associations.shape[1], len(world.object_means))
    random = np.random.default_rng(seed)
    psi = sum(
        sampled_weights(world, world.predicted_robot(), objects, classes, random, 5000)
        for _ in range(num_samples // 5000)
    )
    by_association = psi.reshape(len(associations), -1).sum(axis=1)
    assert (objects[:: psi.size // len(associations)] == associations).all()
    return by_association / by_association.sum()


@pytest.mark.parametrize("seed", [0, 3])
def test_the_reference_is_what_samples_from_the_prior_tend_to(seed: int) -> None:
    world = grid_world(seed, num_detections=2, noise=KNOWN_START)
    reference = reference_posterior(world, seed, FEW)
    batches = np.array([_sampled(world, reference.associations, 20_000, [seed, i]) for i in range(10)])
    scatter = batches.std(axis=0, ddof=1) / np.sqrt(len(batches))
    difference = np.abs(batches.mean(axis=0) - reference.probabilities)
    assert (difference < 5.0 * scatter + 3e-4).all()
    assert reference.error < 3e-3 and 0.05 < reference.probabilities.max() < 0.9999


@pytest.mark.parametrize("aligned", [False, True])
def test_the_engine_agrees_with_the_reference_where_the_sampler_does_not(aligned: bool) -> None:
    found = [weights_accuracy.errors(seed, aligned, FEW) for seed in range(3)]
    assert np.median([errors.candidates for errors in found]) < 0.03
    assert np.median([errors.thesis for errors in found]) > 0.1
    for errors in found:
        assert errors.belief < errors.candidates + errors.discarded + 1e-3
        assert errors.reference.error < 5e-3


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
