"""How good the names are: at the end of the drives, on the way, and how soon they settle."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.evaluation.classification import expected_calibration_error, negative_log_likelihood
from semantic_slam.evaluation.history import first_settled
from semantic_slam_lab.studies.own_detector.courses import Course

SURE = 0.9
"""Probability of the true class from which on an object's name is settled."""
LEAST_VIEWS, LEAST_LEAD = 5, 2.0
"""Evidence carries a name from so many views on, so many times as many of which bear it as any other."""
METRICS = {
    "nll": "NLL at the end [nats]",
    "ece": "ECE at the end",
    "correct_rate_final": "right at the end",
    "nll_online": "NLL on the way",
    "ece_online": "ECE on the way",
    "settled_share": "settled",
    "settled_keyframe": "settled after [keyframes]",
}
"""Name in result.json -> words on the page."""


@dataclass(frozen=True, kw_only=True)
class Named:
    """One true object under one method."""

    course: Course
    is_carried: bool  # whether its labels are evidence enough for its name


def summary(named: Sequence[Named]) -> dict[str, float]:
    """Averages over objects; probabilities below 1e-12 count as that in logarithms."""
    last = np.concatenate([own.course.probabilities[-1:] for own in named])
    final_true = np.array([own.course.true_column for own in named])
    every = np.concatenate([own.course.probabilities for own in named])
    every_true = np.repeat(final_true, [len(own.course.probabilities) for own in named])
    settled = [first_settled(own.course.true_probability, SURE) for own in named]
    after = [
        len(own.course.probabilities) if found is None else found for own, found in zip(named, settled, strict=True)
    ]
    return {
        "nll": negative_log_likelihood(last, final_true),
        "ece": expected_calibration_error(last, final_true),
        "correct_rate_final": float(np.mean(last.argmax(axis=1) == final_true)),
        "nll_online": negative_log_likelihood(every, every_true),
        "ece_online": expected_calibration_error(every, every_true),
        "settled_share": float(np.mean([found is not None for found in settled])),
        "settled_keyframe": float(np.mean(after)),
    }


def carried(labels: Sequence[str], true_class: str) -> bool:
    """Whether an object's labels carry its true name."""
    own = labels.count(true_class)
    other = max((labels.count(name) for name in {*labels} - {true_class}), default=0)
    return len(labels) >= LEAST_VIEWS and own >= LEAST_LEAD * other
