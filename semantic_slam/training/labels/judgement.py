"""Judgement of label models by the words of stretches that they were not fitted to."""

from collections.abc import Iterator, Sequence

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.training.judgement import Judgement
from semantic_slam.training.labels.expectation import replayed
from semantic_slam.training.labels.fit import Fitted
from semantic_slam.training.labels.passes import FOLDS, Pass, views_of, with_views
from semantic_slam.training.labels.tracks import Track

LEAST_WEIGHT = 0.5
"""Tracks that are less likely are not judged."""


def judged(fitted: Fitted, tracks: Sequence[Track]) -> Judgement:
    """By all stretches."""
    found = [
        (*word, number)
        for own, fold in zip(fitted.passes[:-1], FOLDS[:-1], strict=True)
        for number, track in enumerate(tracks)
        if track.weight >= LEAST_WEIGHT
        for word in _words(own, track, fold)
    ]
    size = fitted.whole.model.num_words
    return Judgement(
        log_evidence=fitted.held_out,
        probabilities=np.array([own for own, _, _ in found]).reshape(-1, size),
        answers=np.array([answer for _, answer, _ in found], dtype=int),
        objects=np.array([number for _, _, number in found], dtype=int),
    )


def _words(own: Pass, track: Track, fold: int) -> Iterator[tuple[Array, int]]:
    """Each word that was held out, with the (W,) probabilities of what it might have been."""
    kept, left = views_of(track, fold)
    told = replayed(own.model, track, kept)
    for view in left:
        if view.word.answer >= 0:
            probabilities = own.model.word_probabilities(told.record, view)
            yield np.einsum("r,rk,rkw->w", own.weights, told.rows, probabilities), view.word.answer
        told = with_views(own.model, told, [view])
