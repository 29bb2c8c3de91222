"""Baseline classifiers from the literature, compared with in the thesis (Sec. 3.4.1)."""

from dataclasses import replace
from typing import Self

import numpy as np

from semantic_slam.classification.classifier import SequentialClassifier, View
from semantic_slam.classification.joint import JointClassifier
from semantic_slam.classification.processes import ClassProcesses
from semantic_slam.geometry.arrays import Array

SCORE_CLIP = 0.01
"""Lower bound of scores in simple Bayes: a single zero would rule out a class permanently."""


class ModelBasedClassifier(JointClassifier):
    """Teacy et al.: likelihood of the mean scores under the joint process; ignores the dropout spread."""

    def __init__(
        self, processes: ClassProcesses, log_prior: Array, num_tracks: int = 1, *, window: int | None = None
    ) -> None:
        super().__init__(processes, log_prior, num_tracks, coupling="per_component", window=window)

    def empty(self, num_tracks: int) -> Self:
        return type(self)(self._processes, self.log_prior, num_tracks, window=self._window)

    def of_class(self, class_index: int) -> Self:
        return type(self)(self._processes.only(class_index), np.zeros(1), window=self._window)

    def update(self, view: View) -> Array:
        certain = replace(view.scores, covariance=np.zeros_like(view.scores.covariance))
        return super().update(View(view.locations_m, certain))


class SimpleBayesClassifier(SequentialClassifier):
    """Patten et al.: the mean scores are used as class likelihoods, independent between views."""

    def __init__(self, log_prior: Array, num_tracks: int = 1, *, clip: float = SCORE_CLIP) -> None:
        super().__init__(log_prior, num_tracks)
        self._clip = clip

    def empty(self, num_tracks: int) -> Self:
        return type(self)(self.log_prior, num_tracks, clip=self._clip)

    def update(self, view: View) -> Array:
        scores = np.maximum(view.scores.mean, self._clip)
        return self._weigh(np.tile(np.log(scores), (self.num_tracks, 1, 1)))
