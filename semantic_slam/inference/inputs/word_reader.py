"""A detector's labels and scores as words, with estimated scores of the classes below its threshold.

A class that was not reported is not impossible: its score is below the reported ones. What these leave of 1 is shared
evenly among the classes that were not reported, none of which gets more than the least reported score.
"""

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.models.detector_words import NO_WORD, DetectorWords
from semantic_slam.perception.measurement import SemanticMeasurements

LEAST_LEFT = 0.02
"""Least sum of the scores that is assigned to classes that were not reported: no detector is surer than that."""
LEAST_SCORE = 1e-3
"""Lower limit of the score of a reported class."""


class WordReader:
    """Reads the words of detections; ``labels`` (L,) are words 0 to L - 1, any other label is word L."""

    def __init__(self, labels: tuple[str, ...]) -> None:
        self._numbers = {label: number for number, label in enumerate(labels)}
        self._num_words = len(labels) + 1
        self._known: tuple[tuple[str, ...], Index] = (
            (),
            np.zeros(0, dtype=int),
        )  # class names, and the words that they are

    def words(self, measurements: SemanticMeasurements) -> DetectorWords:
        """Words of all detections: that of a detection's label, or else of the class with the best score."""
        every = self._scores(measurements)
        answers, shares = [], []
        for row, label in enumerate(measurements.labels):
            told = every[row]
            answer = self._number(label) if label else int(np.argmax(told)) if np.isfinite(told).any() else NO_WORD
            answers.append(answer)
            shares.append(self._shares(told, answer, float(measurements.scores[row])))
        return DetectorWords(
            answers=np.array(answers, dtype=int), shares=np.array(shares).reshape(len(answers), self._num_words)
        )

    def _columns(self, class_names: tuple[str, ...]) -> Index:
        """Words of the classes ``class_names``; cached, as a detector's classes always have the same order."""
        if self._known[0] != class_names:
            self._known = class_names, np.array(list(map(self._number, class_names)), dtype=int)
        return self._known[1]

    def _number(self, label: str) -> int:
        return self._numbers.get(label, self._num_words - 1)

    def _scores(self, measurements: SemanticMeasurements) -> Array:
        """(D, W) scores of the words, -inf where none was reported; scores of labels of the same word are summed."""
        scores, columns = measurements.class_scores, self._columns(measurements.class_names)
        rows, names = np.nonzero(np.isfinite(scores))
        told, words = np.full((len(scores), self._num_words), -np.inf), columns[names]
        told[rows, words] = 0.0
        np.add.at(told, (rows, words), np.maximum(scores[rows, names], LEAST_SCORE))
        return told

    def _shares(self, told: Array, answer: int, score: float) -> Array:
        """(W,) normalised scores of one detection, from the reported ones ``told`` (W,) and its own ``score``."""
        if answer == NO_WORD:
            return np.full(self._num_words, 1.0 / self._num_words)
        if not np.isfinite(told[answer]):
            told[answer] = max(score, LEAST_SCORE) if np.isfinite(score) else 1.0
        reported = np.isfinite(told)
        kept = np.where(reported, told, 0.0)
        if reported.all():
            return np.asarray(kept / kept.sum())
        left = max(1.0 - float(kept.sum()), LEAST_LEFT) / float((~reported).sum())
        shares = np.where(reported, kept, min(left, float(kept[reported].min())))
        return np.asarray(shares / shares.sum())
