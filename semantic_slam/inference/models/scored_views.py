"""What observation models with classes have in common: scores of views, beside their own geometry."""

from typing import Any

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.observation import Classes, Linearisation
from semantic_slam.inference.models.view_scores import ViewScores


class ScoredViews:
    """The semantic part of an observation model; ``scores`` None: geometry alone."""

    scores: ViewScores | None

    @property
    def num_classes(self) -> int:
        """Classes that hypotheses enumerate, 0 without class models."""
        return 0 if self.scores is None else len(self.scores.model.class_names)

    def semantics(self, detections: Any, x: Array, o: Array, classes: Classes) -> Linearisation:
        """Residual of the feature under Eq. 4.2."""
        return self._view_scores.linearised(detections, x, o, classes)

    def best_heading(self, detections: Any, x: Array, o: Array, classes: Classes, sigma: Array) -> tuple[Array, Array]:
        """Best headings over a window of them, the objects' prior deviating by ``sigma`` (B,) [rad]."""
        return self._view_scores.best_heading(detections, x, o, classes, sigma)

    def log_outlier(self, seen: Any) -> Array | None:
        """(S,) log of the share of outliers times the density of the score as one; None: no view is an outlier."""
        return None if self.scores is None else self.scores.log_outlier(seen)

    @property
    def _view_scores(self) -> ViewScores:
        """Scores of views, which are asked for where there are classes alone."""
        assert self.scores is not None
        return self.scores
