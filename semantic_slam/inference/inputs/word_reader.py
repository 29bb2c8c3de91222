"""A detector's labels and scores as words: what it reported, and what its threshold hides.

A class that was not reported is not impossible: its score lies below those that were. What these leave of 1 is shared
evenly among the classes that were not reported, none of which gets more than the least that was.
"""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.detector_words import NO_WORD, DetectorWords
from semantic_slam.perception.measurement import SemanticMeasurements

LEAST_LEFT = 0.02
"""Share of 1 that reported scores leave at least to what was not reported: no detector is surer than that."""
LEAST_SCORE = 1e-3
"""Score of a class that was reported at least."""


class WordReader:
    """Reads the words of measurements; ``labels`` (L,) are the words that it knows, any other is word L."""

    def __init__(self, labels: tuple[str, ...]) -> None:
        self._numbers = {label: number for number, label in enumerate(labels)}
        self._num_words = len(labels) + 1

    def words(self, measurements: SemanticMeasurements) -> DetectorWords:
        """Words of all detections; the label is what a detection is called, else the class with the best score."""
        columns = [self._number(name) for name in measurements.class_names]
        answers, shares = [], []
        for row, label in enumerate(measurements.labels):
            told = self._scores(measurements, row, columns)
            answer = self._number(label) if label else int(np.argmax(told)) if np.isfinite(told).any() else NO_WORD
            answers.append(answer)
            shares.append(self._shares(told, answer, float(measurements.scores[row])))
        return DetectorWords(
            answers=np.array(answers, dtype=int), shares=np.array(shares).reshape(len(answers), self._num_words)
        )

    def _number(self, label: str) -> int:
        return self._numbers.get(label, self._num_words - 1)

    def _scores(self, measurements: SemanticMeasurements, row: int, columns: list[int]) -> Array:
        """(W,) scores of the words, -inf where none was reported; labels that are one word add up."""
        told = np.full(self._num_words, -np.inf)
        for column, score in zip(columns, measurements.class_scores[row].tolist(), strict=True):
            if np.isfinite(score):
                told[column] = max(told[column], 0.0) + max(score, LEAST_SCORE)
        return told

    def _shares(self, told: Array, answer: int, score: float) -> Array:
        """(W,) of one detection, of reported scores and its own."""
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
