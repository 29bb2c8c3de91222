"""What is added to a map is likelier of the classes that are there, as if their shares were learned from it."""

from itertools import permutations

import numpy as np
import pytest
from scipy.special import gammaln

from semantic_slam.inference.semantics.detector.new_classes import NewClasses

SHARES = np.array([0.5, 0.3, 0.2])
COUNTS = 4.0


def log_probability(classes: tuple[int, ...], added: list[int]) -> float:
    """Of objects of certain classes, added in an order, each by the shares that those before it leave."""
    new, known, total = NewClasses(shares=SHARES, counts=COUNTS), np.zeros((0, 3)), 0.0
    for number in added:
        cls = classes[number]
        total += np.log(SHARES[cls]) + new.log_ratios(known)[cls]
        known = np.concatenate([known, np.eye(3)[cls : cls + 1]])
    return total


def test_objects_of_certain_classes_weigh_what_a_dirichlet_of_shares_says() -> None:
    classes = (0, 1, 1, 1, 2)
    counts, prior = np.bincount(classes), COUNTS * SHARES
    exact = gammaln(COUNTS) - gammaln(COUNTS + len(classes)) + (gammaln(prior + counts) - gammaln(prior)).sum()
    for order in list(permutations(range(len(classes))))[::7]:
        assert log_probability(classes, list(order)) == pytest.approx(exact, abs=1e-12)


def test_an_empty_map_leaves_the_shares_as_they_were() -> None:
    np.testing.assert_allclose(NewClasses(shares=SHARES, counts=COUNTS).log_ratios(np.zeros((0, 3))), 0.0, atol=1e-12)


def test_what_nothing_is_told_of_changes_no_shares() -> None:
    found = NewClasses(shares=SHARES, counts=COUNTS).log_ratios(np.tile(SHARES, (9, 1)))
    np.testing.assert_allclose(found, 0.0, atol=1e-12)


def test_shares_that_count_as_many_objects_are_hardly_changed() -> None:
    known = np.tile(np.eye(3)[2], (9, 1))
    few, many = (NewClasses(shares=SHARES, counts=counts).log_ratios(known) for counts in (1.0, 1e9))
    assert np.exp(few[2]) * SHARES[2] == pytest.approx((0.2 + 9.0) / 10.0)
    np.testing.assert_allclose(many, 0.0, atol=1e-6)
