"""Which object of the map stands for which true object."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from worlds.belief_factory import CLASSES, START, run_configuration, small_belief

from semantic_slam.evaluation.correspondence import match_objects, told_by_map
from semantic_slam.evaluation.evaluate import Evaluation, evaluate
from semantic_slam.evaluation.record import GroundTruth, Record
from semantic_slam.evaluation.trajectory import Trajectory
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import pose_vector_from_planar
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam.messages.ground_truth import GroundTruthObjects

PLACES = {"0": np.array([6.0, -1.0, 0.0]), "1": np.array([5.0, 1.0, 0.0]), "2": np.array([3.0, -1.0, 0.0])}
NO_TRACK = Trajectory(np.zeros(0, dtype=np.int64), np.zeros((0, 7)))


def test_what_is_told_comes_before_the_majority_of_the_detections() -> None:
    assert match_objects(["1", "2"], {"1": 2, "2": 1, "3": 3}, []) == {"1": 2, "2": 1}
    # Object 0 shares three detections with "a", one with "b"; "b" gets what is left.
    pairs = [("a", 0)] * 3 + [("b", 0), ("b", 1), ("a", 1), ("c", -1)]
    assert match_objects(["a", "b", "c"], {}, pairs) == {"a": 0, "b": 1}
    assert match_objects(["a", "b", "c"], {"c": 0}, pairs) == {"c": 0, "a": 1}


@pytest.mark.parametrize(
    ("names", "stands", "told"),
    [
        ({0: "object_0", 2: "object_2"}, {0: "0", 2: "2"}, {"0": 0, "object_0": 0, "2": 2, "object_2": 2}),
        # Surveyed, and moved since: numbers of a surveyed map hold wherever its objects stand.
        ({0: "object_0", 2: "object_2"}, {0: "2", 2: "0"}, {"0": 0, "object_0": 0, "2": 2, "object_2": 2}),
        ({0: "0", 1: "1", 2: "2"}, {0: "0", 1: "1", 2: "2"}, {"0": 0, "1": 1, "2": 2}),  # written without names
        ({0: "0", 1: "1", 2: "2"}, {0: "2", 1: "1", 2: "0"}, {"1": 1}),  # numbered as a run has met them
        ({0: "2", 1: "0", 2: "1"}, {0: "2", 1: "0", 2: "1"}, {"2": 0, "0": 1, "1": 2}),  # named by true ids
        ({0: "2", 1: "0", 2: "1"}, {0: "1", 1: "2", 2: "0"}, {}),  # named by a tracker that has its own numbers
    ],
)
def test_a_map_tells_true_ids_by_its_names_and_by_numbers_only_where_its_objects_stand_there(
    names: Mapping[int, str], stands: Mapping[int, str], told: dict[str, int]
) -> None:
    assert told_by_map(_map(names, {number: PLACES[true] for number, true in stands.items()}), PLACES) == told


def test_without_true_places_numbers_count_unless_a_run_has_saved_the_map() -> None:
    written = _map({0: "0", 2: "2"}, {0: PLACES["0"], 2: PLACES["2"]})
    assert told_by_map(written, {}) == {"0": 0, "2": 2}
    assert told_by_map(replace(written, map_id="552edf9332db84ab"), {}) == {}


def test_a_second_session_is_judged_by_its_associations_and_not_by_the_numbers_of_the_first() -> None:
    """The first session met "2" first and called it 0; the second takes every detection for the right object."""
    stands = {0: PLACES["2"], 1: PLACES["1"], 2: PLACES["0"]}
    numbered = _evaluated(_map({0: "0", 1: "1", 2: "2"}, stands))
    assert numbered.matches == {"0": 2, "1": 1, "2": 0}
    assert numbered.metrics["association_right"] == 1.0 and numbered.metrics["keyframe_disambiguated"] == 0
    np.testing.assert_allclose(numbered.true_association_probability, 1.0)
    # The same beliefs on a map that came with the truth: two of three objects are taken for each other.
    surveyed = _evaluated(_map({n: f"object_{n}" for n in range(3)}, {n: PLACES[str(n)] for n in range(3)}))
    assert surveyed.matches == {"0": 0, "1": 1, "2": 2} and surveyed.metrics["association_right"] == pytest.approx(
        1 / 3
    )


def _map(names: Mapping[int, str], places: Mapping[int, Array]) -> MapPrior:
    at = {number: (float(place[0]), float(place[1])) for number, place in places.items()}
    return MapPrior(
        tuple(ObjectPrior.planar(n, *at[n], sigma_m=0.1, sigma_rad=0.1, name=name) for n, name in names.items())
    )


def _evaluated(known: MapPrior) -> Evaluation:
    """Two keyframes of one hypothesis: it takes the true "2", "1", "0" for the objects 0, 1, 2."""
    beliefs = [
        small_belief(k, ids=[k + 1], parents=[k], weights=[1.0], objects=[0, 1, 2], associations=[[0, 1, 2]])
        for k in range(2)
    ]
    run = replace(run_configuration(Path("nowhere"), CLASSES, ("",) * 7), map_prior=known.to_json())
    objects = GroundTruthObjects(
        START, tuple(PLACES), ("desk",) * 3, pose_vector_from_planar(np.array([*PLACES.values()]))
    )
    truth = GroundTruth(NO_TRACK, objects, {belief.stamp_ns: ("2", "1", "0") for belief in beliefs})
    return evaluate(Record(run, tuple(beliefs), NO_TRACK, {}, truth), truth)
