"""Evaluation of fitted models on what they were not fitted to: log evidence, and calibration of predicted answers."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.evaluation.classification import expected_calibration_error
from semantic_slam.geometry.arrays import Array, Index

RESAMPLES = 200
DOUBT = 0.05
"""Share of the resamples of objects in which a difference may be smaller than what is said of it."""
LEAST_GAIN = 3.0
"""Nats by which held-out log evidence has to be better than before any fit."""
MOST_MISCALIBRATION = 0.02
"""How much more than before any fit the calibration error of held-out answers may surely be."""


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """How good models are at N answers, of W possible ones, that they were not fitted to."""

    log_evidence: float  # nats
    probabilities: Array  # (N, W) of the answers that there might have been
    answers: Index  # (N,) those that there were
    objects: Index  # (N,) the object of each

    @property
    def calibration_error(self) -> float:
        """The expected calibration error of the likeliest answer."""
        return self._calibration_error(slice(None))

    def is_better_than(self, before: "Judgement") -> bool:
        """Whether the evidence is clearly greater than ``before`` any fit, and the calibration not surely worse."""
        if not len(self.answers) or self.log_evidence < before.log_evidence + LEAST_GAIN:
            return False
        return self.worse_calibrated_than(before) <= MOST_MISCALIBRATION

    def worse_calibrated_than(self, other: "Judgement") -> float:
        """By how much the error is surely greater than that of another judgement of the same answers.

        A difference between the errors of a few hundred answers, which come in objects, is mostly chance: it is told by
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
