"""Common part of observation models with classes: the scores of views, beside the geometry."""

from typing import Any

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.observation import Classes, Linearisation
from semantic_slam.inference.models.view_scores import ViewScores


class ScoredViews:
    """The semantic part of an observation model; ``scores`` None: geometry alone."""

    scores: ViewScores | None

    @property
    def num_classes(self) -> int:
        """Number of classes that hypotheses enumerate; 0 without class models."""
        return 0 if self.scores is None else len(self.scores.model.class_names)

    def semantics(self, detections: Any, x: Array, o: Array, classes: Classes) -> Linearisation:
        """Residual of the feature under Eq. 4.2."""
        return self._view_scores.linearised(detections, x, o, classes)

    def best_heading(self, detections: Any, x: Array, o: Array, classes: Classes, sigma: Array) -> tuple[Array, Array]:
        """Best headings within a window; prior standard deviation ``sigma`` (B,) [rad] of the objects' headings."""
        return self._view_scores.best_heading(detections, x, o, classes, sigma)

    def log_outlier(self, seen: Any) -> Array | None:
        """(S,) log of the outlier share times the score's density as an outlier; None: no view is an outlier."""
        return None if self.scores is None else self.scores.log_outlier(seen)

    @property
    def _view_scores(self) -> ViewScores:
        """The scores of views; asked for only where there are classes."""
        assert self.scores is not None
        return self.scores
