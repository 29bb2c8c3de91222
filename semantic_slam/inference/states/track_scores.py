"""Track scores: whether the detections of an object are of one thing, or each of them is a false alarm.

A hypothesis is sure of an object that it has associated twice, since the rival hypothesis, in which both detections
are false alarms, has a weight of its own. Rivals are pruned. The track score of an object, the log likelihood ratio of
a thing to a series of false alarms (Sittler 1964; Blackman and Popoli 1999, Sec. 6.2), is kept with it, and tells how
heavy the rival would be, whether or not it is still followed.
"""

import numpy as np
from scipy.special import expit

from semantic_slam.geometry.arrays import Array

LARGEST = 700.0
"""Largest track score that is reported, and minus the least one, in nats."""


def log_odds(existence: Array) -> Array:
    """(...,) track scores of objects with this probability (...,) of existence; infinite where that is 1."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.maximum(np.log(existence) - np.log1p(-existence), -LARGEST))


def false_alarm_probability(track_scores: Array) -> Array:
    """(...,) probability that all detections of an object are false alarms, by its track score (...,)."""
    return np.asarray(expit(-track_scores))


def existence_beside_rivals(weights: Array, existed: Array, track_scores: Array) -> Array:
    """(O,) factors on the existence of objects under H hypotheses, for their rivals that are no longer followed.

    ``weights`` (H,) of the hypotheses; ``existed`` (H, O) probability that objects exist or have left, and
    ``track_scores`` (H, O); NaN where a hypothesis has none. Each hypothesis shares its weight with the rival in which
    the detections of an object are false alarms. Rivals are followed as far as the hypotheses doubt the object: only
    where they weigh more than that, they are missing, and the larger of both doubts is stated.
    """
    known = weights[:, None] * np.nan_to_num(existed)
    there = known.sum(axis=0)
    false = (known * false_alarm_probability(np.nan_to_num(track_scores, nan=LARGEST))).sum(axis=0)
    return np.where(false > 1.0 - there, (1.0 - false) / np.where(there > 0.0, there, 1.0), 1.0)
