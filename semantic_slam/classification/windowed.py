"""Common base of the recursive and the joint classifier: per-class processes over the views of a track."""

from abc import abstractmethod
from typing import Literal, Self

import numpy as np

from semantic_slam.classification.classifier import SequentialClassifier
from semantic_slam.classification.growing_gaussian import GrowingGaussian
from semantic_slam.classification.processes import ClassProcesses
from semantic_slam.classification.track import TrackViews
from semantic_slam.geometry.arrays import Array, Index

Coupling = Literal["full", "per_component"]
"""Coupling of a score's components by Sigma_z: the full matrix, or only its diagonal."""


class WindowedClassifier(SequentialClassifier):
    """Models the scores of all views, or of the newest W (``window``), as one Gaussian per class."""

    _scores: GrowingGaussian

    def __init__(
        self,
        processes: ClassProcesses,
        log_prior: Array,
        num_tracks: int = 1,
        *,
        coupling: Coupling = "full",
        window: int | None = None,
    ) -> None:
        super().__init__(log_prior, num_tracks)
        self._processes, self._coupling, self._window = processes, coupling, window
        self._views = TrackViews(processes, num_tracks)
        self._begin()

    def empty(self, num_tracks: int) -> Self:
        return type(self)(self._processes, self.log_prior, num_tracks, coupling=self._coupling, window=self._window)

    def of_class(self, class_index: int) -> Self:
        """Classifier with these settings for one class only: its evidence is p(z_0:k | track, class)."""
        processes = self._processes.only(class_index)
        return type(self)(processes, np.zeros(1), coupling=self._coupling, window=self._window)

    def replace(self, rows: Index, other: Self, source: Index) -> None:
        super().replace(rows, other, source)
        self._views.replace(rows, other._views, source)
        self._scores.replace(rows, other._scores, source)

    def _keep_window(self) -> None:
        if self._window is not None and len(self._views) > self._window:
            self._views.drop_first()
            self._drop_first()
            self.dropped += 1

    @abstractmethod
    def _begin(self) -> None:
        """Initialise ``_scores`` and other per-view state, without views."""

    @abstractmethod
    def _drop_first(self) -> None:
        """Drop the scores of the first view."""
