"""What people do with the labels of a mapped object's detections, without a model of the detector."""

from collections.abc import Sequence

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.studies.own_detector.courses import CLASSES, Rule, Told

LEAST_SCORE = 0.01
"""A product counts a class that was not reported, or less, as this: below what the detectors report."""


def labels_counted(views: Sequence[Told]) -> Array:
    """Share of each label, with one view more that is spread evenly (a Dirichlet prior of one count)."""
    counts = np.full(len(CLASSES), 1.0 / len(CLASSES))
    for told in views:
        counts[CLASSES.index(told.label)] += 1.0
    return np.asarray(counts / counts.sum())


def arg_max(views: Sequence[Told]) -> Array:
    """The most frequent label for certain; of those that are as frequent, the one that comes first in the alphabet."""
    if not views:
        return np.full(len(CLASSES), 1.0 / len(CLASSES))
    certain = np.zeros(len(CLASSES))
    certain[int(np.argmax(labels_counted(views)))] = 1.0
    return certain


def running_product(views: Sequence[Told]) -> Array:
    """Scores multiplied as if views were independent and scores likelihoods."""
    scores = np.array([told.scores for told in views]).reshape(len(views), len(CLASSES))
    return product_of_scores(np.nan_to_num(scores))


def product_of_scores(scores: Array) -> Array:
    """(C,) normalised product of (V, C) scores, each at least ``LEAST_SCORE``; even without views."""
    logs = np.log(np.maximum(scores, LEAST_SCORE)).sum(axis=0)
    return np.asarray(np.exp(logs - np.logaddexp.reduce(logs)))


RULES: dict[str, Rule] = {
    "labels_counted": labels_counted,
    "arg_max": arg_max,
    "running_product": running_product,
}
