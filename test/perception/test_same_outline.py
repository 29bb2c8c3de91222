"""Detections with one outline, or at one place without a box, are one, which is called by the names of all."""

from dataclasses import replace

import numpy as np
import pytest

from semantic_slam.configuration import Configuration
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.perception.boxes.same_outline import joined, overlaps
from semantic_slam.perception.measurement import SemanticMeasurements

THING, AGAIN, HALF, ELSEWHERE = [10.0, 10.0, 50.0, 50.0], [11.0, 10.0, 51.0, 50.0], [10.0, 10.0, 30.0, 50.0], [60.0] * 4
NOWHERE = [np.nan] * 4
AS_SHIPPED = Configuration.of()


def measured(boxes: list[list[float]], labels: list[str], **changes: object) -> SemanticMeasurements:
    """Detections with scores 0.5, 0.6, 0.7, ..."""
    seen = [
        Detection(bearing_rad=0.1 * n, range_m=1.0 + n, label=label, score=0.5 + 0.1 * n)
        for n, label in enumerate(labels)
    ]
    told = Keyframe.planar(0, detections=seen).measurements
    return replace(told, boxes=np.array(boxes), **changes)


def scores_of(measurements: SemanticMeasurements, row: int) -> dict[str, float]:
    named = zip(measurements.class_names, measurements.class_scores[row].tolist(), strict=True)
    return {name: score for name, score in named if np.isfinite(score)}


def test_overlap_is_intersection_over_union():
    boxes = np.array([THING, HALF, ELSEWHERE, NOWHERE])
    found = overlaps(boxes, boxes)
    np.testing.assert_allclose(found[:2, :2], [[1.0, 0.5], [0.5, 1.0]])
    assert not found[2:].any()


def test_a_laptop_that_is_a_tv_too_is_one_detection_with_both_names():
    one = joined(measured([THING, AGAIN, HALF], ["tv", "laptop", "cup"]), AS_SHIPPED)
    assert one.labels == ("laptop", "cup")
    assert one.ranges_m.tolist() == [2.0, 3.0] and one.detection_ids.tolist() == [1, 2]
    assert scores_of(one, 0) == pytest.approx({"laptop": 0.6, "tv": 0.5})
    assert scores_of(one, 1) == pytest.approx({"cup": 0.7})


def test_all_hypotheses_of_both_boxes_count_the_better_score_of_each():
    told = measured([THING, AGAIN], ["tv", "laptop"], class_names=("cup", "tv"),
                    class_scores=np.array([[0.3, 0.5], [0.1, np.nan]]),
                    class_probability_samples=np.zeros((2, 0, 2)))  # fmt: skip
    assert scores_of(joined(told, AS_SHIPPED), 0) == pytest.approx({"laptop": 0.6, "tv": 0.5, "cup": 0.3})


@pytest.mark.parametrize("boxes", [[THING, HALF], [THING, ELSEWHERE], [NOWHERE, NOWHERE], [[0.0] * 4] * 2])
def test_boxes_with_other_outlines_and_places_apart_stay(boxes):
    told = measured(boxes, ["tv", "laptop"])
    assert joined(told, AS_SHIPPED) is told


def test_one_joins_all_or_none_are_joined_where_asked_for():
    told = measured([THING, AGAIN], ["tv", "laptop"])
    assert joined(told, Configuration.of(perception={"same_outline": 1.0})) is told
    assert len(joined(measured([THING] * 4, ["tv", "laptop", "tv", "book"]), AS_SHIPPED)) == 1


def test_identities_that_differ_stay_apart_and_one_that_is_known_is_kept():
    assert len(joined(measured([THING, AGAIN], ["tv", "tv"], track_ids=("1", "2")), AS_SHIPPED)) == 2
    assert joined(measured([THING, AGAIN], ["tv", "tv"], track_ids=("1", "")), AS_SHIPPED).track_ids == ("1",)


def at(*ranges: float, labels: tuple[str, ...] = ("tv", "laptop"), **changes: object) -> SemanticMeasurements:
    """Detections without boxes in one direction."""
    told = measured([NOWHERE] * len(ranges), list(labels))
    return replace(told, ranges_m=np.array(ranges), bearings_rad=np.full(len(ranges), 0.3), **changes)


def test_without_boxes_two_names_of_one_place_are_one_detection():
    one = joined(at(2.0, 2.04), AS_SHIPPED)
    assert one.labels == ("laptop",) and one.ranges_m.tolist() == [2.04]
    assert scores_of(one, 0) == pytest.approx({"laptop": 0.6, "tv": 0.5})


@pytest.mark.parametrize(
    "told",
    [
        at(2.0, 2.06),
        at(2.0, np.nan),
        at(np.nan, np.nan),
        at(2.0, 2.0, elevations_rad=np.array([0.0, 0.1])),
        at(2.0, 2.0, track_ids=("1", "2")),
        at(2.0, 2.0, boxes=np.array([THING, NOWHERE])),
        at(2.0, 2.0, points=np.array([[2.0, 0.0, 0.0], [2.0, 0.0, 0.3]])),
    ],
    ids=["apart", "a bearing", "bearings", "above", "identities", "a box", "points"],
)
def test_without_boxes_other_places_stay(told):
    assert joined(told, AS_SHIPPED) is told


def test_no_places_are_joined_where_asked_for_or_identities_may_follow():
    told = at(2.0, 2.0)
    assert joined(told, Configuration.of(perception={"same_place_m": 0.0})) is told
    assert joined(told, Configuration.of(association="given")) is told
