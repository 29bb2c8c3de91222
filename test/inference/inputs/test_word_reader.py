"""Labels and scores as words: what was reported, and what the threshold of the detector hides."""

import numpy as np
import pytest

from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.inputs.word_reader import WordReader
from semantic_slam.inference.models.detector_words import DetectorWords

READER = WordReader(("chair", "cup", "tv"))


def words(*detections: Detection) -> DetectorWords:
    return READER.words(Keyframe.planar(0, detections=detections).measurements)


def detection(label: str = "", score: float = 1.0, **class_scores: float) -> Detection:
    return Detection(bearing_rad=0.0, range_m=1.0, label=label, score=score, class_scores=class_scores)


def test_shares_sum_to_one_and_are_never_zero():
    told = words(detection("cup", 0.7), detection("", 1.0, chair=0.6, cup=0.5), detection("tv", 1.0), detection())
    np.testing.assert_allclose(told.shares.sum(axis=1), 1.0)
    assert (told.shares > 0.0).all()


def test_what_was_not_reported_is_censored_not_impossible():
    (shares,) = words(detection("chair", 0.6, chair=0.6, cup=0.2)).shares
    np.testing.assert_allclose(shares, [0.6, 0.2, 0.1, 0.1])  # the rest of 1, evenly


def test_no_class_that_was_left_out_scores_more_than_the_least_reported_one():
    (shares,) = words(detection("chair", 0.3, chair=0.3, cup=0.05)).shares
    np.testing.assert_allclose(shares, np.array([0.3, 0.05, 0.05, 0.05]) / 0.45)


def test_a_label_with_a_score_is_a_vector_with_one_entry():
    (shares,) = words(detection("tv", 0.7)).shares
    np.testing.assert_allclose(shares, [0.1, 0.1, 0.7, 0.1])


def test_the_label_is_the_answer_whatever_scores_say():
    told = words(detection("cup", 0.4, chair=0.5, cup=0.4), detection("", 1.0, chair=0.1, tv=0.5), detection())
    assert told.answers.tolist() == [1, 2, -1]


def test_labels_that_nobody_listed_are_one_word():
    told = words(detection("sofa", 0.5, sofa=0.5, bench=0.3, cup=0.1))
    assert told.answers.tolist() == [3]
    np.testing.assert_allclose(told.shares, [[0.05, 0.1, 0.05, 0.8]])
    assert told.shares[0, 3] == pytest.approx(0.8)
