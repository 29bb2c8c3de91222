"""Which hypotheses count as near copies of each other."""

from dataclasses import replace

import numpy as np
import pytest

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry.pose import pose_vector_from_planar
from semantic_slam.inference.open_world.merging import MergeCandidates, merge_copies

SETTINGS = OpenWorldConfiguration(merge_position_m=0.1, merge_object_m=0.15)
IDS = np.array([7, 8], dtype=np.uint64)
WEIGHTS = np.log([0.25, 0.75])
PAIR = MergeCandidates(
    poses=pose_vector_from_planar(np.array([[1.0, 2.0, 0.1], [1.05, 2.0, 0.1]])),
    objects=np.array([[[3.0, 0.0, 0.0]], [[3.1, 0.0, 0.0]]]),
    classes=np.array([[0], [0]]),
    confirms=np.array([[False], [False]]),
    parents=np.array([0, 1]),
    alike=np.ones((2, 2), dtype=bool),
)


def test_the_heavier_one_takes_the_weight_of_its_copy() -> None:
    merged = merge_copies(PAIR, WEIGHTS, IDS, SETTINGS)
    assert merged.kept.tolist() == [1]
    assert merged.count == 1
    np.testing.assert_allclose(merged.log_weights, [0.0], atol=1e-12)


@pytest.mark.parametrize(
    "other",
    [
        {"poses": pose_vector_from_planar(np.array([[1.0, 2.0, 0.1], [1.2, 2.0, 0.1]]))},
        {"poses": pose_vector_from_planar(np.array([[1.0, 2.0, 0.1], [1.0, 2.0, 0.2]]))},
        {"objects": np.array([[[3.0, 0.0, 0.0]], [[3.2, 0.0, 0.0]]])},
        {"classes": np.array([[0], [1]])},
    ],
)
def test_what_differs_in_place_or_class_is_no_copy(other: dict[str, np.ndarray]) -> None:
    merged = merge_copies(replace(PAIR, **other), WEIGHTS, IDS, replace(SETTINGS, merge_ghosts=True))
    assert merged.kept.tolist() == [1, 0]
    np.testing.assert_allclose(merged.log_weights, WEIGHTS[::-1])


@pytest.mark.parametrize("other", [{"confirms": np.array([[True], [False]])}, {"alike": np.eye(2, dtype=bool)}])
def test_what_differs_in_what_exists_is_a_copy_on_request(other: dict[str, np.ndarray]) -> None:
    looks = replace(PAIR, **other)
    assert merge_copies(looks, WEIGHTS, IDS, SETTINGS).count == 0
    assert merge_copies(looks, WEIGHTS, IDS, replace(SETTINGS, merge_ghosts=True)).count == 1


def test_merging_can_be_switched_off() -> None:
    assert merge_copies(PAIR, WEIGHTS, IDS, replace(SETTINGS, merge_position_m=0.0)).count == 0
