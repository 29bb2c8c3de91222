"""Objects that stand elsewhere than the map says: sets of them weighed against the closed form of each."""

from itertools import combinations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from semantic_slam.inference.evidence.displaced import Displacement

NOISE, ROBOT, SHARE, SIGMA = 0.05, 0.5, 0.03, 1.0


def _seen(places: np.ndarray, robot: np.ndarray, truth: np.ndarray, random: np.random.Generator) -> np.ndarray:
    return (truth - robot).ravel() + NOISE * random.normal(size=truth.size)


def _covariances(priors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(2n, 2n) of the map's places with some priors, and (2n, 2) by which a robot's place enters what it sees."""
    count = len(priors)
    spread = np.zeros((2 * count, 2 * count))
    for i, prior in enumerate(priors):
        spread[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = prior
    return spread, -np.tile(np.eye(2), (count, 1))


def _log_evidence(z: np.ndarray, places: np.ndarray, priors: np.ndarray) -> float:
    """Of relative places seen by a robot about the origin."""
    spread, by_robot = _covariances(priors)
    total = spread + ROBOT**2 * by_robot @ by_robot.T + NOISE**2 * np.eye(len(z))
    return float(multivariate_normal(places.ravel(), total).logpdf(z))


@pytest.mark.parametrize("taken", [(), (1,), (0, 3)])
def test_what_was_moved_has_the_posterior_of_all_sets_whatever_a_component_takes_it_for(taken: tuple[int, ...]) -> None:
    random = np.random.default_rng(4)
    places, count = random.uniform(-4.0, 4.0, size=(4, 2)), 4
    priors = np.array([np.diag(random.uniform(0.01, 0.06, size=2)) for _ in range(count)])
    truth = places + np.array([[0.0, 0.0], [0.7, -0.6], [0.1, 0.1], [0.0, 0.45]])
    z = _seen(places, np.zeros(2), truth, random)

    sets = [set(chosen) for size in range(count + 1) for chosen in combinations(range(count), size)]
    logs = []
    for chosen in sets:
        own = np.array([p + SIGMA**2 * np.eye(2) * (i in chosen) for i, p in enumerate(priors)])
        prior = len(chosen) * np.log(SHARE) + (count - len(chosen)) * np.log(1.0 - SHARE)
        logs.append(prior + _log_evidence(z, places, own))
    weights = np.exp(np.array(logs) - np.logaddexp.reduce(logs))
    expected = [sum(w for w, chosen in zip(weights, sets, strict=True) if i in chosen) for i in range(count)]

    is_taken = np.isin(np.arange(count), taken)
    spread, by_robot = _covariances(priors + SIGMA**2 * np.eye(2) * is_taken[:, None, None])
    total = spread + ROBOT**2 * by_robot @ by_robot.T + NOISE**2 * np.eye(2 * count)
    gain = np.linalg.solve(total, spread).T
    found = Displacement(
        offset=(gain @ (z - places.ravel())).reshape(count, 2),
        covariance=spread - gain @ spread,
        prior=priors,
        taken=is_taken,
        share=SHARE,
        sigma_m=SIGMA,
    ).probabilities()
    np.testing.assert_allclose(found, expected, atol=1e-3)  # of 16 sets those that hardly weigh are left out
    assert found[1] > 0.9 > found[3] > found[2]


def test_what_was_not_seen_was_moved_as_often_as_any_object_is() -> None:
    priors = np.array([0.04 * np.eye(2), 0.01 * np.eye(2)])
    covariance = np.diag([0.04, 0.04, 0.01, 0.01])
    unseen = Displacement(
        offset=np.zeros((2, 2)),
        covariance=covariance,
        prior=priors,
        taken=np.zeros(2, dtype=bool),
        share=SHARE,
        sigma_m=SIGMA,
    )
    np.testing.assert_allclose(unseen.probabilities(), SHARE, atol=1e-12)
