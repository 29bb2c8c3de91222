"""Sums of numbers that are kept as logs."""

import numpy as np
import pytest

from semantic_slam.geometry.log_space import finite_log_sum_exp, log_sum_exp


@pytest.mark.parametrize("axis", [-1, -2, 0])
@pytest.mark.parametrize("shift", [0.0, 800.0, -800.0])
def test_sums_are_those_of_the_numbers_wherever_their_logs_lie(axis: int, shift: float) -> None:
    numbers = np.random.default_rng(0).uniform(0.1, 5.0, (2, 3, 4))
    for summed in (log_sum_exp, finite_log_sum_exp):
        np.testing.assert_allclose(summed(np.log(numbers) + shift, axis), np.log(numbers.sum(axis=axis)) + shift)


def test_nothing_sums_to_nothing_without_a_word() -> None:
    with np.errstate(all="raise"):
        assert log_sum_exp(np.array([[-np.inf, -np.inf], [-np.inf, 1.0]])).tolist() == [-np.inf, 1.0]
