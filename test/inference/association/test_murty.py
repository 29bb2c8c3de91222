"""The k best assignments against brute force."""

from itertools import permutations

import numpy as np
import pytest

from semantic_slam.inference.association.murty import k_best


def brute_force(cost: np.ndarray) -> list[tuple[float, tuple[int, ...]]]:
    rows = np.arange(len(cost))
    all_of_them = ((float(cost[rows, list(c)].sum()), c) for c in permutations(range(cost.shape[1]), len(cost)))
    return sorted(item for item in all_of_them if np.isfinite(item[0]))


@pytest.mark.parametrize("seed", range(20))
def test_all_assignments_come_once_and_in_order(seed: int) -> None:
    random = np.random.default_rng(seed)
    rows = int(random.integers(1, 5))
    columns = int(random.integers(rows, 7))
    cost = random.normal(size=(rows, columns))
    cost[random.random(cost.shape) < 0.3] = np.inf
    expected = brute_force(cost)
    found = k_best(cost, len(expected) + 5)
    assert [tuple(row) for row in found.columns] == [columns for _, columns in expected]
    np.testing.assert_allclose(found.costs, [total for total, _ in expected], rtol=1e-12)


def test_the_first_k_are_the_k_cheapest() -> None:
    cost = np.random.default_rng(1).normal(size=(4, 6))
    np.testing.assert_allclose(k_best(cost, 17).costs, [total for total, _ in brute_force(cost)[:17]])


def test_no_assignment_costs_more_than_is_asked_for() -> None:
    cost = np.random.default_rng(2).normal(size=(4, 6))
    every = brute_force(cost)
    expected = [columns for total, columns in every if total <= every[0][0] + 1.5]
    assert 1 < len(expected) < len(every)
    assert [tuple(row) for row in k_best(cost, 1000, within=1.5).columns] == expected


def test_equal_costs_all_come() -> None:
    found = k_best(np.zeros((3, 3)), 100)
    assert len({tuple(row) for row in found.columns}) == 6


def test_no_rows_have_one_empty_assignment() -> None:
    found = k_best(np.zeros((0, 4)), 5)
    assert found.columns.shape == (1, 0)
    assert found.costs.tolist() == [0.0]


def test_what_cannot_be_assigned_has_no_assignment() -> None:
    assert len(k_best(np.array([[1.0, np.inf], [2.0, np.inf]]), 3).costs) == 0
    assert len(k_best(np.zeros((2, 1)), 3).costs) == 0


@pytest.mark.parametrize("seed", range(5))
def test_of_many_rows_in_clusters_the_cheapest_are_those_of_the_whole(seed: int) -> None:
    """Fifteen rows in five groups that share columns, each row with one of its own: all within the bound, in order."""
    random, groups, size = np.random.default_rng(seed), 5, 3
    cost = np.full((groups * size, groups * 2 + groups * size), np.inf)
    for row in range(len(cost)):
        cost[row, [2 * (row // size), 2 * (row // size) + 1, groups * 2 + row]] = random.exponential(2.0, 3)
    found, fewer = k_best(cost, 400, within=3.0), k_best(cost, 37, within=3.0)
    assert len({tuple(row) for row in found.columns}) == len(found.costs) > 37
    assert (np.diff(found.costs) >= 0.0).all() and found.costs[-1] <= found.costs[0] + 3.0
    np.testing.assert_array_equal(fewer.columns, found.columns[:37])
    sums = np.zeros(1)
    for group in range(groups):
        own = [total for total, _ in brute_force(cost[size * group : size * (group + 1)][:, _columns(group)])]
        sums = np.sort((sums[:, None] + np.array(own)).ravel())[:2000]
    np.testing.assert_allclose(found.costs, sums[: len(found.costs)], rtol=1e-12)


def _columns(group: int) -> list[int]:
    return [2 * group, 2 * group + 1, *(10 + 3 * group + n for n in range(3))]
