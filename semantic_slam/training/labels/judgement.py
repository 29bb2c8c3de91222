"""What held-out stretches say of models: log evidence, and whether their words come as often as they are expected."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.evaluation.classification import expected_calibration_error
from semantic_slam.geometry.arrays import Array
from semantic_slam.training.labels.expectation import replayed
from semantic_slam.training.labels.fit import Fitted
from semantic_slam.training.labels.passes import FOLDS, Pass, views_of, with_views
from semantic_slam.training.labels.tracks import Track

LEAST_WEIGHT = 0.5
"""Tracks that are less likely are not judged."""


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """How good the models are at words that they were not fitted to."""

    log_evidence: float  # nats
    calibration_error: float  # of the likeliest word
    num_words: int


def judged(fitted: Fitted, tracks: Sequence[Track]) -> Judgement:
    """By all stretches."""
    found = [
        word
        for own, fold in zip(fitted.passes[:-1], FOLDS[:-1], strict=True)
        for track in tracks
        if track.weight >= LEAST_WEIGHT
        for word in _words(own, track, fold)
    ]
    size = fitted.whole.model.num_words
    probabilities = np.array([probability for probability, _ in found]).reshape(-1, size)
    error = expected_calibration_error(probabilities, np.array([answer for _, answer in found], dtype=int))
    return Judgement(log_evidence=fitted.held_out, calibration_error=error, num_words=len(found))


def _words(own: Pass, track: Track, fold: int) -> Iterator[tuple[Array, int]]:
    """Each word that was held out, with the (W,) probabilities of what it might have been."""
    kept, left = views_of(track, fold)
    told = replayed(own.model, track, kept)
    for view in left:
        if view.answer >= 0:
            probabilities = own.model.word_probabilities(told.record, view)
            yield np.einsum("r,rk,rkw->w", own.weights, told.rows, probabilities), view.answer
        told = with_views(own.model, told, [view])
