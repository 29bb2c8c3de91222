"""What the recursion and the joint classifier have in common: the process of every class over the views of a track."""

from abc import abstractmethod
from typing import Literal, Self

import numpy as np

from semantic_slam.classification.classifier import SequentialClassifier
from semantic_slam.classification.growing_gaussian import GrowingGaussian
from semantic_slam.classification.processes import ClassProcesses
from semantic_slam.classification.track import TrackViews
from semantic_slam.geometry.arrays import Array, Index

Coupling = Literal["full", "per_component"]
"""How Sigma_z couples the components of a score: by its full matrix, or by its diagonal alone."""


class WindowedClassifier(SequentialClassifier):
    """Scores of all views as one Gaussian for each class, or with a ``window`` of W views of the newest W."""

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
        """A classifier with these settings for one class alone: its evidence is p(z_0:k | track, class)."""
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
        """Make ``_scores``, and what else there is of views, of which there are none yet."""

    @abstractmethod
    def _drop_first(self) -> None:
        """Forget the scores of the first view."""
