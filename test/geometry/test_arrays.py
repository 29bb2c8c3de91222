"""Products whose rows do not depend on what stands beside them."""

import numpy as np
import pytest

from semantic_slam.geometry.arrays import row_products


@pytest.mark.parametrize("columns", [1, 5, 32])
def test_a_row_s_product_is_the_same_in_every_batch(columns: int) -> None:
    random = np.random.default_rng(0)
    rows, matrix = random.normal(size=(40, 32)), random.normal(size=(32, columns))
    whole = row_products(rows, matrix)
    np.testing.assert_allclose(whole, rows @ matrix, rtol=0.0, atol=1e-13)
    for count in range(len(rows)):
        np.testing.assert_array_equal(row_products(rows[:count], matrix), whole[:count])
        np.testing.assert_array_equal(row_products(rows[count:], matrix), whole[count:])
