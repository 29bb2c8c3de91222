"""Priors of objects that have errors in common: exact as one factor, and as a tree where the truth is one."""

from collections.abc import Sequence

import gtsam
import numpy as np
import pytest

from semantic_slam.errors import InputError
from semantic_slam.inference.models import joint_prior
from semantic_slam.inference.models.joint_prior import as_factors_say, joint_prior_factors, twin_factors
from semantic_slam.inference.states.gaussian import TwinPrior
from semantic_slam.inference.states.keys import object_key

KEYS = [object_key(n) for n in (4, 1, 9, 2, 7)]


def joint_of(covariance: np.ndarray, twins: Sequence[TwinPrior] = ()) -> np.ndarray:
    """The joint covariance of what the factors say, that of twins last."""
    values, graph = gtsam.Values(), gtsam.NonlinearFactorGraph()
    for row, key in enumerate(KEYS):
        values.insert(key, gtsam.Pose2(float(row), 1.0, 0.3 * row))
    for twin in twins:
        values.insert(object_key(twin.object_id), values.atPose2(object_key(twin.of)))
    for factor in (*joint_prior_factors(KEYS, covariance, values), *twin_factors(twins, values)):
        graph.add(factor)
    isam = gtsam.ISAM2()
    isam.update(graph, values)
    keys = [*KEYS, *(object_key(twin.object_id) for twin in twins)]
    return np.asarray(isam.jointMarginalCovariance(keys).fullMatrix())


def chain() -> np.ndarray:
    """(15, 15) of poses of which each follows from another one with a new error."""
    random = np.random.default_rng(0)
    parents, square = [0, 0, 1, 1, 3], np.zeros((15, 15))
    for row, parent in enumerate(parents):
        own, before = slice(3 * row, 3 * row + 3), slice(3 * parent, 3 * parent + 3)
        gain, noise = random.normal(size=(3, 3)), random.normal(size=(3, 3))
        if row:
            square[own, : 3 * row] = gain @ square[before, : 3 * row]
            square[: 3 * row, own] = square[own, : 3 * row].T
            square[own, own] = gain @ square[before, before] @ gain.T
        square[own, own] += noise @ noise.T + 0.1 * np.eye(3)
    return square


def test_one_factor_says_the_joint_gaussian() -> None:
    random = np.random.default_rng(1).normal(size=(15, 15))
    square = random @ random.T + 0.1 * np.eye(15)
    np.testing.assert_allclose(joint_of(square), square, rtol=1e-8, atol=1e-8)


def test_a_tree_says_it_where_the_truth_is_a_tree(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(joint_prior, "MOST_TOGETHER", 2)
    np.testing.assert_allclose(joint_of(chain()), chain(), rtol=1e-6, atol=1e-8)


def test_a_tree_keeps_every_objects_own_gaussian(monkeypatch: pytest.MonkeyPatch) -> None:
    """And understates what objects have in common that it does not join."""
    monkeypatch.setattr(joint_prior, "MOST_TOGETHER", 2)
    square = np.kron(np.ones((5, 5)), 0.04 * np.eye(3)) + np.diag(np.linspace(0.001, 0.01, 15))
    found = joint_of(square)
    for row in range(5):
        own = slice(3 * row, 3 * row + 3)
        np.testing.assert_allclose(found[own, own], square[own, own], rtol=1e-8)
    assert (found < square + 1e-9).all() and found[0, 12] > 0.5 * square[0, 12]


@pytest.mark.parametrize("most", [2, 5])
def test_what_the_factors_say_is_known_without_them(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(joint_prior, "MOST_TOGETHER", most)
    square = np.kron(np.ones((5, 5)), 0.04 * np.eye(3)) + np.diag(np.linspace(0.001, 0.01, 15))
    np.testing.assert_allclose(as_factors_say(square, 5), joint_of(square), rtol=1e-6)


def test_a_displaced_twin_is_about_its_object_wherever_that_is() -> None:
    square, moved = chain(), np.diag([1.0, 1.0, 1e-6])
    found = joint_of(square, [TwinPrior(3, 9, moved)])
    own = slice(3 * KEYS.index(object_key(9)), 3 * KEYS.index(object_key(9)) + 3)
    np.testing.assert_allclose(found[:15, :15], square, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(found[15:, :15], square[own], rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(found[15:, 15:], square[own, own] + moved, rtol=1e-6)


def test_what_is_no_covariance_is_refused() -> None:
    with pytest.raises(InputError, match="not positive definite"):
        joint_of(np.zeros((15, 15)))
