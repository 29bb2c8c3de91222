"""Adapting a fitted label model to a run whose label set differs from the fitted one.

A label that was not fitted counted as the "other" word until now, and is confused as the fitted labels are on average;
a fitted label that the run does not have becomes part of its "other" word.
"""

from dataclasses import replace

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.viewpoint.labels.confusion import Confusion
from semantic_slam.viewpoint.labels.model import LabelModel


def with_vocabulary(model: LabelModel, labels: tuple[str, ...]) -> LabelModel:
    """Label model converted to the label set ``labels``."""
    if labels == model.labels:
        return model
    places = [model.labels.index(label) if label in model.labels else -1 for label in labels]
    known = [model.class_shares[place] for place in places if place >= 0]
    least = min(known, default=1.0)
    shares = np.array([model.class_shares[place] if place >= 0 else least for place in places])
    shares = np.append(shares, model.class_shares[-1])
    words = _words(model.labels, labels)
    return replace(
        model,
        labels=labels,
        confusions=tuple(_renamed(own, words, places) for own in model.confusions),
        class_shares=shares / shares.sum(),
    )


def _words(fitted: tuple[str, ...], labels: tuple[str, ...]) -> Array:
    """(fitted words, words) share of each fitted word assigned to each word of the run."""
    shares = np.zeros((len(fitted) + 1, len(labels) + 1))
    for number, label in enumerate(fitted):
        shares[number, labels.index(label) if label in labels else -1] = 1.0
    others = [number for number, label in enumerate(labels) if label not in fitted] + [len(labels)]
    shares[-1, others] = 1.0 / len(others)
    return shares


def _renamed(fitted: Confusion, words: Array, places: list[int]) -> Confusion:
    renamed = fitted.counts @ words
    sectors, _, size = renamed.shape
    counts = float(fitted.counts.sum(axis=-1).mean())
    accuracy = float(np.trace(fitted.counts.mean(axis=0))) / (counts * fitted.counts.shape[1])
    unseen = Confusion.symmetric(size - 1, accuracy, counts, fitted.outlier_share)
    rows = [
        renamed[:, place] if place >= 0 else np.tile(unseen.counts[0, n], (sectors, 1))
        for n, place in enumerate(places)
    ]
    unknown = float(fitted.none[0].sum())
    none = Confusion.symmetric(size - 1, float(fitted.none[0, -1]) / unknown, unknown, fitted.outlier_share).none
    return Confusion(counts=np.stack(rows, axis=1), none=none, outlier_share=fitted.outlier_share)
