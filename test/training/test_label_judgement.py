"""Models that are surer than they are right are told from models that only seem so."""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.training.judgement import Judgement

NUM_OBJECTS, NUM_VIEWS = 30, 20


def judgement(answers: Array, likeliest: float) -> Judgement:
    """Of words that are taken to be the first of two with one probability."""
    probabilities = np.tile([likeliest, 1.0 - likeliest], (len(answers), 1))
    objects = np.repeat(np.arange(NUM_OBJECTS), NUM_VIEWS)
    return Judgement(log_evidence=0.0, probabilities=probabilities, answers=answers, objects=objects)


def test_what_is_much_too_sure_is_surely_worse_calibrated() -> None:
    answers = (np.random.default_rng(0).random(NUM_OBJECTS * NUM_VIEWS) > 0.7).astype(int)
    right, too_sure = judgement(answers, 0.7), judgement(answers, 0.95)
    assert too_sure.worse_calibrated_than(right) > 0.15
    assert right.worse_calibrated_than(too_sure) < 0.0


def test_a_difference_that_a_few_objects_make_is_chance() -> None:
    """A fifth of the objects is always called otherwise: one probability seems worse by that, but not surely."""
    answers = np.repeat(np.arange(NUM_OBJECTS) % 5 == 0, NUM_VIEWS).astype(int)
    nearer, farther = judgement(answers, 0.8), judgement(answers, 0.84)
    assert farther.calibration_error - nearer.calibration_error > 0.03
    assert farther.worse_calibrated_than(nearer) < 0.02
