"""Which matrices are covariances that can be computed with."""

import numpy as np
import pytest

from semantic_slam.geometry.small_matrices import are_covariances


@pytest.mark.parametrize(
    ("matrix", "is_one"),
    [
        ([[1.0, 0.0], [0.0, 2.0]], True),
        ([[1.0, 0.5], [0.5 + 1e-12, 2.0]], True),
        ([[1e-6, 0.0], [0.0, 1e6]], True),
        ([[1.0, 0.5], [-0.5, 2.0]], False),  # its determinant is positive
        ([[0.0, 0.0], [0.0, 1.0]], False),
        ([[-1.0, 0.0], [0.0, -1.0]], False),
        ([[1.0, 1.0], [1.0, 1.0]], False),
        ([[1.0, 2.0], [2.0, 1.0]], False),
        ([[1e-300, 0.0], [0.0, 1.0]], False),
        ([[1e300, 0.0], [0.0, 1e300]], False),
        ([[np.nan, 0.0], [0.0, 1.0]], False),
        ([[1.0, np.nan], [np.nan, 1.0]], False),
        ([[np.inf, 0.0], [0.0, 1.0]], False),
    ],
)
def test_a_covariance_is_symmetric_bounded_and_positive_definite(matrix: list[list[float]], is_one: bool) -> None:
    assert are_covariances(np.array([np.eye(2), matrix])).tolist() == [True, is_one]


def test_no_matrices_yield_no_verdicts() -> None:
    assert are_covariances(np.zeros((0, 2, 2))).shape == (0,)
