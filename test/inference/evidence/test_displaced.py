"""Objects that stand elsewhere than the map says: sets of them weighed against the closed form of each."""

from itertools import combinations

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.stats import multivariate_normal

from semantic_slam.inference.evidence.displaced import Displacement

NOISE, ROBOT, SHARE, SIGMA = 0.05, 0.5, 0.03, 1.0


def _seen(places: np.ndarray, robot: np.ndarray, truth: np.ndarray, random: np.random.Generator) -> np.ndarray:
    return (truth - robot).ravel() + NOISE * random.normal(size=truth.size)


def _by_robot(count: int) -> np.ndarray:
    """(2n, 2) by which a robot's place enters what it sees."""
    return -np.tile(np.eye(2), (count, 1))


def _moved(spread: np.ndarray, moved: set[int]) -> np.ndarray:
    """(2n, 2n) of the map's places if some objects were moved."""
    return spread + SIGMA**2 * np.diag(np.repeat([float(i in moved) for i in range(len(spread) // 2)], 2))


def _log_evidence(z: np.ndarray, places: np.ndarray, spread: np.ndarray) -> float:
    """Of relative places seen by a robot about the origin."""
    by_robot = _by_robot(len(places))
    total = spread + ROBOT**2 * by_robot @ by_robot.T + NOISE**2 * np.eye(len(z))
    return float(multivariate_normal(places.ravel(), total).logpdf(z))


@pytest.mark.parametrize("common", [0.0, 0.3, 2.0])
@pytest.mark.parametrize("taken", [(), (1,), (0, 3)])
def test_what_was_moved_has_the_posterior_of_all_sets_whatever_a_component_takes_it_for(
    taken: tuple[int, ...], common: float
) -> None:
    """Also where the whole map may be off by a ``common`` error [m]."""
    random = np.random.default_rng(4)
    places, count = random.uniform(-4.0, 4.0, size=(4, 2)), 4
    priors = np.array([np.diag(random.uniform(0.01, 0.06, size=2)) for _ in range(count)])
    spread = block_diag(*priors) + common**2 * np.tile(np.eye(2), (count, count))
    truth = places + common + np.array([[0.0, 0.0], [0.7, -0.6], [0.1, 0.1], [0.0, 0.45]])
    z = _seen(places, np.zeros(2), truth, random)

    sets = [set(chosen) for size in range(count + 1) for chosen in combinations(range(count), size)]
    logs = []
    for chosen in sets:
        prior = len(chosen) * np.log(SHARE) + (count - len(chosen)) * np.log(1.0 - SHARE)
        logs.append(prior + _log_evidence(z, places, _moved(spread, chosen)))
    weights = np.exp(np.array(logs) - np.logaddexp.reduce(logs))
    expected = [sum(w for w, chosen in zip(weights, sets, strict=True) if i in chosen) for i in range(count)]

    assumed, by_robot = _moved(spread, set(taken)), _by_robot(count)
    total = assumed + ROBOT**2 * by_robot @ by_robot.T + NOISE**2 * np.eye(2 * count)
    gain = np.linalg.solve(total, assumed).T
    found = Displacement(
        offset=(gain @ (z - places.ravel())).reshape(count, 2),
        covariance=assumed - gain @ assumed,
        prior=assumed,
        taken=np.isin(np.arange(count), taken),
        weighed=np.arange(count),
        share=SHARE,
        sigma_m=SIGMA,
    ).probabilities()
    np.testing.assert_allclose(found, expected, atol=1e-3)  # of 16 sets those that hardly weigh are left out
    assert found[1] > 0.9 > found[3] > found[2]


def test_what_was_not_seen_was_moved_as_often_as_any_object_is() -> None:
    covariance = np.diag([0.04, 0.04, 0.01, 0.01]) + 0.5 * np.tile(np.eye(2), (2, 2))
    unseen = Displacement(
        offset=np.zeros((2, 2)),
        covariance=covariance,
        prior=covariance,
        taken=np.zeros(2, dtype=bool),
        weighed=np.arange(2),
        share=SHARE,
        sigma_m=SIGMA,
    )
    np.testing.assert_allclose(unseen.probabilities(), SHARE, atol=1e-12)
