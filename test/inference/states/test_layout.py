"""Blocks of a robot and its landmarks: every form says where the same numbers are."""

import numpy as np
import pytest

from semantic_slam.inference.states.layout import Layout

LAYOUTS = [Layout(3, 3), Layout(2, 2), Layout(3, 2), Layout(2, 3), Layout(6, 3)]
COUNT = 4


def pieces(layout: Layout, values: np.ndarray) -> list[np.ndarray]:
    """The states' own coordinates, cut one after another."""
    ends = np.cumsum([layout.robot] + [layout.landmark] * COUNT)
    return np.split(values, ends[:-1], axis=-1)


@pytest.fixture(params=LAYOUTS, ids=lambda layout: f"{layout.robot}+{layout.landmark}")
def layout(request: pytest.FixtureRequest) -> Layout:
    return request.param


def test_slices_starts_and_rows_agree(layout: Layout) -> None:
    values = np.arange(layout.size(COUNT))
    for place, piece in enumerate(pieces(layout, values)):
        np.testing.assert_array_equal(values[layout.block(place)], piece)
        assert layout.starts(np.array([place]))[0] == piece[0]
    places = [2, 0, 4]
    expected = np.concatenate([pieces(layout, values)[place] for place in places])
    np.testing.assert_array_equal(layout.rows(places), expected)
    assert layout.count(len(values)) == COUNT and len(layout.rows([])) == 0


def test_blocks_and_joined_are_inverse(layout: Layout) -> None:
    """Along any axis, and for no landmark at all."""
    random = np.random.default_rng(0)
    for axis in (-1, -2):
        shape = [5, layout.size(COUNT), layout.size(COUNT)]
        values = random.normal(size=shape)
        blocks = layout.blocks(values, axis)
        moved = np.moveaxis(blocks, (axis - 1, axis), (-2, -1))
        for place, piece in enumerate(pieces(layout, np.moveaxis(values, axis, -1))):
            np.testing.assert_array_equal(moved[..., place, : piece.shape[-1]], piece)
        np.testing.assert_array_equal(layout.joined(blocks, axis), values)
    alone = random.normal(size=(5, layout.robot))
    np.testing.assert_array_equal(layout.joined(layout.blocks(alone)), alone)


def test_equal_sizes_copy_nothing() -> None:
    values = np.zeros((5, 15, 15))
    for layout in (Layout(3, 3), Layout(5, 5)):
        for axis in (-1, -2):
            assert np.shares_memory(layout.blocks(values, axis), values)
        assert np.shares_memory(layout.square_blocks(values), values)
        assert np.shares_memory(layout.diagonal(values), values)


def test_square_blocks_and_diagonals(layout: Layout) -> None:
    matrix = np.random.default_rng(1).normal(size=(2, layout.size(COUNT), layout.size(COUNT)))
    blocks, diagonal = layout.square_blocks(matrix), layout.diagonal(matrix)
    for a in range(1 + COUNT):
        rows = layout.block(a)
        size = rows.stop - rows.start
        np.testing.assert_array_equal(diagonal[:, a, :size, :size], matrix[:, rows, rows])
        for b in range(1 + COUNT):
            columns = layout.block(b)
            own = blocks[:, a, :size, b, : columns.stop - columns.start]
            np.testing.assert_array_equal(own, matrix[:, rows, columns])


def test_slots_read_their_states_and_free_ones_anything(layout: Layout) -> None:
    places = np.array([[0, 3, 1], [0, 0, 4]])
    rows = layout.rows_of_slots(places)
    np.testing.assert_array_equal(rows[0], layout.rows([0, 3, 1]))
    np.testing.assert_array_equal(rows[1, -layout.landmark :], layout.rows([4]))
    assert rows.shape == (2, layout.size(2)) and rows.max() < layout.size(COUNT)
    nothing = layout.rows_of_slots(np.zeros((1, 3), dtype=int))
    assert nothing.max() < layout.size(0)
    np.testing.assert_array_equal(
        layout.repeated(np.array([True, False, True])),
        np.repeat([True, False, True], [layout.robot, layout.landmark, layout.landmark]),
    )


def test_stacks_are_as_wide_as_the_wider(layout: Layout) -> None:
    random = np.random.default_rng(2)
    robots, landmarks = random.normal(size=(2, 1, layout.robot)), random.normal(size=(2, 3, layout.landmark))
    found = layout.stacked(robots, landmarks)
    np.testing.assert_array_equal(found[:, :1, : layout.robot], robots)
    np.testing.assert_array_equal(found[:, 1:, : layout.landmark], landmarks)
    square, squares = np.eye(layout.robot), np.ones((3, layout.landmark, layout.landmark))
    together = layout.stacked_squares(square, squares)
    np.testing.assert_array_equal(together[0, : layout.robot, : layout.robot], square)
    np.testing.assert_array_equal(together[1:, : layout.landmark, : layout.landmark], squares)
