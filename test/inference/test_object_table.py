"""The one carrier of per-object quantities, row by row against loops."""

from dataclasses import replace

import numpy as np
import pytest
from worlds.distinct_values import of

from semantic_slam.inference.object_table import (
    QUANTITIES,
    ObjectTable,
    columns,
    marginals,
    over,
    stack_rows,
    table_row,
    without_views,
)
from semantic_slam.inference.protocol import Components

PRIOR = np.array([[0.5, 0.5], [0.2, 0.8], [0.9, 0.1], [0.3, 0.7]])
"""Four objects, two classes."""


def table() -> ObjectTable:
    return of(Components).objects


def small_table() -> ObjectTable:
    """Two hypotheses over objects 1 and 3 of four."""
    poses = np.tile([1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0], (2, 2, 1))
    return without_views(
        2,
        PRIOR[[1, 3]],
        object_poses=poses,
        object_covariances=np.tile(np.eye(6), (2, 2, 1, 1)),
        existence=np.array([[0.5, 0.25], [1.0, 0.75]]),
        descriptors=np.zeros((2, 2, 3)),
        descriptor_covariances=np.ones((2, 2, 3)),
    )


def test_rows_stacked_again_are_the_table() -> None:
    found = stack_rows([table_row(table(), row) for row in range(len(table().existence))])
    for name, values in columns(table()).items():
        np.testing.assert_array_equal(getattr(found, name), values, err_msg=name)


def test_what_is_left_out_stays_left_out() -> None:
    left_out = replace(table(), moving=np.zeros(0), object_velocities=np.zeros(0))
    for found in (
        stack_rows([table_row(left_out, 0)]),
        over(replace(small_table(), moving=np.zeros(0)), np.array([1, 3]), PRIOR),
    ):
        assert not found.moving.size and not found.object_velocities.size
    weights = np.full(len(left_out.existence), 1.0 / len(left_out.existence))
    assert not marginals(weights, left_out)["moving"].size


def test_rows_that_leave_a_quantity_out_do_not_take_it_from_the_others() -> None:
    own = table()
    rows = [table_row(own, 0), table_row(replace(own, moving=np.zeros(0)), 1)]
    found = stack_rows(rows).moving
    np.testing.assert_array_equal(found, [own.moving[0], np.full_like(own.moving[0], np.nan)])


def test_nothing_seen_of_any_object_leaves_their_prior() -> None:
    found = small_table()
    np.testing.assert_array_equal(found.class_probabilities, [PRIOR[[1, 3]]] * 2)
    assert np.isnan(found.mutual_information).all() and found.in_coverage.all() and not found.forgotten_views.any()


def test_objects_that_a_table_lacks_are_absent() -> None:
    found = over(small_table(), np.array([1, 3]), PRIOR)
    np.testing.assert_array_equal(found.existence, [[np.nan, 0.5, np.nan, 0.25], [np.nan, 1.0, np.nan, 0.75]])
    np.testing.assert_array_equal(found.class_probabilities, [PRIOR] * 2)
    assert np.isnan(found.object_poses[:, [0, 2]]).all() and np.isfinite(found.object_poses[:, [1, 3]]).all()
    assert found.in_coverage.all() and found.forgotten_views.dtype == np.uint32


def test_a_table_of_no_hypothesis_may_not_know_how_many_classes_there_are() -> None:
    own = small_table()
    empty = replace(own, **{name: values[:0, :0] for name, values in columns(own).items() if values.ndim > 1})
    empty = replace(empty, class_probabilities=np.zeros((0, 0, 0)))
    found = over(empty, np.zeros(0, dtype=int), PRIOR)
    assert found.class_probabilities.shape == (0, *PRIOR.shape)


def test_every_quantity_has_a_marginal_of_its_own_shape() -> None:
    own = table()
    weights = np.arange(1.0, 1.0 + len(own.existence))
    weights /= weights.sum()
    usable = replace(own, object_poses=np.ones_like(own.object_poses), object_covariances=_units(own))
    found = marginals(weights, usable)
    assert {*found} == {*QUANTITIES}
    for name, values in columns(usable).items():
        assert found[name].shape == values.shape[1:] and found[name].dtype == values.dtype, name


def _units(own: ObjectTable) -> np.ndarray:
    return np.broadcast_to(np.eye(6), own.object_covariances.shape)


def test_marginals_are_the_averages_that_their_rules_say() -> None:
    weights = np.array([0.25, 0.75])
    found = marginals(weights, over(small_table(), np.array([1, 3]), PRIOR))
    np.testing.assert_allclose(found["existence"], [0.0, 0.875, 0.0, 0.625])  # absent is 0
    np.testing.assert_allclose(found["class_probabilities"], PRIOR)
    assert np.isnan(found["mutual_information"]).all() and np.isnan(found["object_poses"][0]).all()


def test_how_an_object_moves_is_told_given_that_it_exists() -> None:
    """Of two hypotheses, one is of something that moves, the other of two false alarms."""
    weights, exists, moves = np.array([0.9857, 0.0143]), np.array([1.0, 0.184]), np.array([1.0, 0.150])
    own = replace(small_table(), existence=exists[:, None] * [1.0, 0.0], moving=moves[:, None] * [1.0, 0.5])
    found = marginals(weights, own)["moving"]
    assert found[0] == pytest.approx((0.9857 + 0.0143 * 0.184 * 0.150) / (0.9857 + 0.0143 * 0.184))
    assert found[1] == pytest.approx(0.5 * weights @ moves)  # exists in neither


def test_a_velocity_is_averaged_over_the_hypotheses_that_know_it() -> None:
    velocities = np.full((2, 2, 6), np.nan)
    velocities[1, 0], velocities[:, 1, 0] = 2.0, [1.0, 3.0]
    found = marginals(np.array([0.25, 0.75]), replace(small_table(), object_velocities=velocities))
    np.testing.assert_allclose(found["object_velocities"][0], np.full(6, 2.0))
    there = np.array([0.25 * 0.25, 0.75 * 0.75])  # weights times existence
    assert found["object_velocities"][1, 0] == pytest.approx(there @ [1.0, 3.0] / there.sum())
    assert np.isnan(found["object_velocities"][1, 1])


def test_an_object_is_missing_with_the_weight_of_the_hypotheses_in_which_it_was_there() -> None:
    missing = np.full((2, 2), np.nan)
    missing[0, 0] = 1.0
    found = marginals(np.array([0.25, 0.75]), replace(small_table(), missing=missing))
    assert found["missing"][0] == pytest.approx(0.25) and np.isnan(found["missing"][1])
