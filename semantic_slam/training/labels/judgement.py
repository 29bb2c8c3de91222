"""Evaluation of label models on held-out stretches: log evidence, and calibration of predicted words."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.evaluation.classification import expected_calibration_error
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.training.labels.expectation import replayed
from semantic_slam.training.labels.fit import Fitted
from semantic_slam.training.labels.passes import FOLDS, Pass, views_of, with_views
from semantic_slam.training.labels.tracks import Track

LEAST_WEIGHT = 0.5
"""Tracks that are less likely are not judged."""
RESAMPLES = 200
DOUBT = 0.05
"""Share of the resamples of objects in which a difference may be smaller than what is said of it."""


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """How good the models are at N words that they were not fitted to."""

    log_evidence: float  # nats
    probabilities: Array  # (N, W) of the words that there might have been
    answers: Index  # (N,) those that there were
    objects: Index  # (N,) the track of each

    @property
    def calibration_error(self) -> float:
        """The expected calibration error of the likeliest word."""
        return self._calibration_error(slice(None))

    @property
    def numbers(self) -> dict[str, float]:
        """By name, for reports."""
        return {
            "log_evidence": self.log_evidence,
            "calibration_error": self.calibration_error,
            "num_words": len(self.answers),
        }

    def worse_calibrated_than(self, other: "Judgement") -> float:
        """By how much the error is surely greater than that of another judgement of the same words.

        A difference between the errors of a few hundred words, which come in objects, is mostly chance: it is told by
        resamples of the objects.
        """
        random = np.random.default_rng(0)
        rows = [np.flatnonzero(self.objects == number) for number in np.unique(self.objects)]
        differences = []
        for _ in range(RESAMPLES):
            drawn = np.concatenate([rows[number] for number in random.integers(len(rows), size=len(rows))])
            differences.append(self._calibration_error(drawn) - other._calibration_error(drawn))
        return float(np.quantile(differences, DOUBT))

    def _calibration_error(self, rows: Index | slice) -> float:
        return expected_calibration_error(self.probabilities[rows], self.answers[rows])


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
