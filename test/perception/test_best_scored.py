"""A frame with too many detections: those with the best scores are used, the others are counted."""

from collections import Counter

import numpy as np

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.perception.best_scored import TOO_MANY, best_scored
from semantic_slam.perception.frame import Detections
from semantic_slam.perception.places import PlaceReader


def test_the_best_are_used_in_their_order_and_the_others_counted() -> None:
    dropped, scores = Counter[str](), np.array([0.2, 0.9, np.nan, 0.9, 0.5, 0.9])
    found = best_scored(np.array([0, 1, 2, 3, 5]), scores, 2, dropped, "topic: ")
    assert found.tolist() == [1, 3] and dropped == {f"topic: {TOO_MANY}": 3}


def test_no_limit_keeps_all() -> None:
    dropped, rows = Counter[str](), np.arange(300)
    assert best_scored(rows, np.zeros(300), 0, dropped) is rows and not dropped


def test_places_have_the_numbers_of_the_detections_that_they_are_of() -> None:
    count = 8
    detections = Detections(
        stamp_ns=1,
        frame_id="base_link",
        boxes=np.full((count, 4), np.nan),
        labels=("chair",) * count,
        scores=np.linspace(0.1, 0.8, count),
        track_ids=("",) * count,
        ranges_m=np.append(np.full(count - 1, 2.0), -1.0),  # the last one is no place
        bearings_rad=np.zeros(count),
    )
    reader = PlaceReader(PerceptionConfiguration(max_detections=3))
    measured = reader.measure(detections, 0)
    assert measured.detection_ids.tolist() == [4, 5, 6] and measured.dropped == 5
    assert reader.dropped[TOO_MANY] == 4
