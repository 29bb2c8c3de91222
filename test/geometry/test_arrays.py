"""Arrays of few rows: products that do not depend on what stands beside them, different rows, places of values."""

import numpy as np
import pytest

from semantic_slam.geometry.arrays import column_products, distinct_rows, places_among, row_products


@pytest.mark.parametrize("columns", [1, 5, 32])
def test_a_row_s_product_is_the_same_in_every_batch(columns: int) -> None:
    random = np.random.default_rng(0)
    rows, matrix = random.normal(size=(40, 32)), random.normal(size=(32, columns))
    whole = row_products(rows, matrix)
    np.testing.assert_allclose(whole, rows @ matrix, rtol=0.0, atol=1e-13)
    for count in range(len(rows)):
        np.testing.assert_array_equal(row_products(rows[:count], matrix), whole[:count])
        np.testing.assert_array_equal(row_products(rows[count:], matrix), whole[count:])


@pytest.mark.parametrize("rows", [1, 3, 9])
def test_a_column_s_product_is_the_same_whatever_columns_stand_beside_it(rows: int) -> None:
    random = np.random.default_rng(0)
    matrices, columns = random.normal(size=(5, rows, 9)), random.normal(size=(5, 9, 54))
    whole = column_products(matrices, columns)
    np.testing.assert_allclose(whole, matrices @ columns, rtol=0.0, atol=1e-13)
    for count in range(1, 54):
        chosen = np.sort(random.permutation(54)[:count])
        np.testing.assert_array_equal(column_products(matrices, columns[..., chosen]), whole[..., chosen])


def test_distinct_rows_are_those_of_numpy() -> None:
    rows = np.random.default_rng(0).integers(-1, 2, size=(40, 3))
    for count in (0, 1, 40):
        found, which = distinct_rows(rows[:count])
        np.testing.assert_array_equal(found, np.unique(rows[:count], axis=0))
        np.testing.assert_array_equal(found[which], rows[:count])


def test_places_among_ascending_numbers_are_those_of_the_values_that_are_there() -> None:
    random = np.random.default_rng(0)
    for count in (0, 1, 6):
        ascending = np.sort(random.permutation(12)[:count])
        values = random.integers(-1, 13, (5, 4))
        places, there = places_among(ascending, values)
        np.testing.assert_array_equal(there, np.isin(values, ascending))
        np.testing.assert_array_equal(ascending[places[there]], values[there])
