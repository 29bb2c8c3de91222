"""Which hypotheses count as near copies of each other."""

from dataclasses import replace

import numpy as np
import pytest

from semantic_slam.configuration import Configuration, OpenWorldConfiguration, PruningConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import pose_vector_from_planar
from semantic_slam.inference.candidate_table import CandidateTable
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.open_world.copies import Copies
from semantic_slam.inference.open_world.merging import MergeCandidates, merge_copies
from semantic_slam.inference.states.identity import ROOT_ID

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


@pytest.mark.parametrize(("place_m", "copies_of"), [(1.0, [[0, 1], [2, 3]]), (0.0, [[0, 1], [2], [3]])])
def test_copies_of_whatever_pruning_may_keep_are_merged(place_m: float, copies_of: list[list[int]]) -> None:
    robots = np.array([[0.0, 0.0, 0.0], [0.02, 0.0, 0.0], [5.0, 0.0, 0.0], [5.02, 0.0, 0.0]])
    weights = np.array([0.0, -1.0, -12.0, -12.5])
    pruning = PruningConfiguration(place_m=place_m, ratio=1000.0, kind_ratio=1e12)
    copies = Copies(Engine(Configuration(association="open", pruning=pruning)).problem)
    merged = copies.merged(candidates_of_one_new_object(robots, weights))
    np.testing.assert_allclose(merged.log_weights, [np.logaddexp.reduce(weights[rows]) for rows in copies_of])


def candidates_of_one_new_object(robots: Array, log_weights: Array) -> CandidateTable:
    """Candidates (K) of the first keyframe, each with a new object a metre ahead of its robot (K, 3)."""
    count = len(robots)
    ahead = robots + np.array([1.0, 0.0, 0.0])
    return CandidateTable(
        ids=np.arange(count, dtype=np.uint64),
        parent_ids=np.full(count, ROOT_ID, dtype=np.uint64),
        associations=np.zeros((count, 1), dtype=np.int32),
        classes=np.full((count, 1), -1, dtype=np.int32),
        modes=np.zeros(count, dtype=np.uint16),
        changes=np.full(count, None, dtype=object),
        log_weights=log_weights,
        innovation_nees=np.full(count, np.nan),
        outlier_probability=np.zeros((count, 1)),
        poses=pose_vector_from_planar(robots),
        object_poses=pose_vector_from_planar(ahead)[:, None],
        log_missing=np.full(1, -np.inf),
    )
