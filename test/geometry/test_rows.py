"""Selections of tables: every column alike, what is no column untouched."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pytest

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.rows import Selection, take


@dataclass(frozen=True)
class Poses:
    xy: Array  # (B, 2)
    yaw: Array | None = None  # (B,)


@dataclass(frozen=True)
class Fleet:
    names: tuple[str, ...]  # of all robots there are
    poses: Poses
    speed: Array  # (B,)
    weights: Array = field(default_factory=lambda: np.ones(7))  # of something else

    @cached_property
    def mean_speed(self) -> float:
        return float(self.speed.mean())


POSES = Poses(np.arange(8.0).reshape(4, 2), np.arange(4.0))


@pytest.mark.parametrize(
    "selection", [np.array([2, 0, 2]), np.array([True, False, True, False]), slice(1, 3), np.zeros(0, dtype=int)]
)
def test_columns_are_selected_as_arrays_are(selection: Selection) -> None:
    some = take(POSES, selection)
    assert type(some) is Poses and POSES.yaw is not None and some.yaw is not None
    np.testing.assert_array_equal(some.xy, POSES.xy[selection])
    np.testing.assert_array_equal(some.yaw, POSES.yaw[selection])


def test_a_column_that_is_not_there_stays_so() -> None:
    assert take(Poses(POSES.xy), np.array([1])).yaw is None


def test_only_named_fields_are_columns_and_what_was_worked_out_is_not_kept() -> None:
    fleet = Fleet(("a", "b"), POSES, np.array([1.0, 2.0, 3.0, 6.0]))
    assert fleet.mean_speed == 3.0
    some = take(fleet, np.array([3, 1]), ("poses", "speed"))
    assert some.names is fleet.names and some.weights is fleet.weights
    np.testing.assert_array_equal(some.poses.xy, POSES.xy[[3, 1]])
    assert some.mean_speed == 4.0
