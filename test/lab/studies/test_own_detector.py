"""The study of a user's own detector: what the drawn detector errs in, and what the rules beside ours say."""

from collections import Counter

import numpy as np
import pytest

pytest.importorskip("semantic_slam_lab")

from semantic_slam_lab.simulation.detectors.detector_boxes import Box, BoxFaults, torn
from semantic_slam_lab.simulation.detectors.detector_words import (
    BY_SIDE,
    BY_VIEW,
    NAMES,
    DetectorFaults,
    Seen,
    hypotheses,
)
from semantic_slam_lab.studies.own_detector.baselines import arg_max, labels_counted, running_product
from semantic_slam_lab.studies.own_detector.courses import CLASSES, Course, Told
from semantic_slam_lab.studies.own_detector.scores import Named, carried, summary

LEFT, RIGHT = np.array([10.0, 10.0, 30.0, 40.0]), np.array([32.0, 10.0, 60.0, 40.0])


def told(label: str, **scores: float) -> Told:
    return Told(label=label, scores=np.array([scores.get(name, np.nan) for name in CLASSES]))


def called(confusion: str, azimuth: float, seed: int, detector: int = 3) -> str:
    random = np.random.default_rng(seed)
    seen = Seen(name="chair", number=1, azimuth_rad=azimuth)
    return hypotheses(seen, DetectorFaults(confusion=confusion), random, detector).names[0]


def test_by_view_one_box_in_five_is_confused_and_mostly_from_one_direction():
    around = np.linspace(-np.pi, np.pi, 36, endpoint=False)
    wrong = np.array([[called(BY_VIEW, azimuth, seed) != "chair" for seed in range(60)] for azimuth in around])
    assert wrong.mean() == pytest.approx(0.2, abs=0.03)
    by_azimuth = np.convolve(np.tile(wrong.mean(axis=1), 2), np.ones(6) / 6, mode="valid")
    assert by_azimuth.max() > 0.5 and by_azimuth.min() < 0.05


def test_by_side_an_object_is_called_alike_from_one_side_whatever_the_bag():
    assert all(len({called(BY_SIDE, azimuth, seed) for seed in range(10)}) == 1 for azimuth in (-2.0, 0.1, 1.0, 2.5))


def test_boxes_are_doubled_split_and_merged():
    boxes = [Box(edges=LEFT, object_id="1"), Box(edges=RIGHT, object_id="2")]
    random = np.random.default_rng(0)
    assert torn(boxes, BoxFaults(), 100, random) == boxes
    twice = torn(boxes, BoxFaults(doubled=1.0), 100, random)
    assert [(own.object_id, own.is_second) for own in twice] == [("1", False), ("1", True), ("2", False), ("2", True)]
    halves = torn(boxes[:1], BoxFaults(split=1.0), 100, random)
    assert [own.edges[[0, 2]].tolist() for own in halves] == [[10.0, 21.0], [19.0, 30.0]]
    (one,) = torn(boxes, BoxFaults(merged=1.0), 100, random)
    assert one.edges.tolist() == [10.0, 10.0, 60.0, 40.0] and one.object_id == "2"


def test_rules_say_what_they_are_called():
    views = [told("chair", chair=0.6, tv=0.3), told("tv", tv=0.5, chair=0.4), told("chair", chair=0.7)]
    chair, tv = CLASSES.index("chair"), CLASSES.index("tv")
    assert labels_counted(views)[chair] == pytest.approx((2.0 + 1.0 / len(CLASSES)) / 4.0)
    assert arg_max(views)[chair] == 1.0
    product = running_product(views)
    assert product[chair] / product[tv] == pytest.approx(0.6 * 0.4 * 0.7 / (0.3 * 0.5 * 0.01))
    for rule in (labels_counted, arg_max, running_product):
        assert rule([]).sum() == pytest.approx(1.0) and rule(views).sum() == pytest.approx(1.0)


def test_names_settle_where_the_true_class_stays_likely():
    p = np.array([0.3, 0.95, 0.8, 0.95, 0.97])
    rows = np.full((5, len(CLASSES)), 1.0) * ((1.0 - p) / (len(CLASSES) - 1))[:, None]
    rows[:, CLASSES.index("chair")] = p
    found = summary([Named(course=Course(object_id="1", probabilities=rows, true_class="chair"), is_carried=True)])
    assert found["settled_keyframe"] == 3.0 and found["correct_rate_final"] == 1.0
    assert found["nll"] == pytest.approx(-np.log(0.97)) and found["nll_online"] == pytest.approx(-np.log(p).mean())


def test_labels_carry_a_name_that_leads():
    assert carried(["chair"] * 4 + ["tv"] * 2, "chair") and not carried(["chair"] * 3 + ["tv"] * 2, "chair")
    assert not carried(["chair"] * 4, "chair")
    assert Counter(NAMES.values()).keys() < set(CLASSES)
