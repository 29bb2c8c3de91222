"""Class scores of views: their density under the viewpoint-dependent class models (Eq. 4.2)."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from semantic_slam.geometry.arrays import Array, broadcast_copy, squared_norms
from semantic_slam.geometry.log_space import LOG_2PI
from semantic_slam.geometry.small_matrices import cholesky, forward
from semantic_slam.inference.models.observation import Classes, Linearisation
from semantic_slam.inference.models.repeated_rows import per_detection
from semantic_slam.viewpoint.model import Prediction, ViewpointModel, Viewpoints
from semantic_slam.viewpoint.outliers import OutlierScores

LEAST_WINDOW_RAD = 0.6
"""Least half width of the window of azimuths that is searched about a mode."""
WINDOW_ANGLES, NARROW_WINDOW_ANGLES, WIDE_WINDOW_RAD = 25, 13, 1.2
"""Number of azimuths evaluated in a window, in a narrow window, and half width above which a window is wide."""

Slopes = Callable[[Array], tuple[Array, Array]]
"""Chain rule: (B, m, q) derivatives by viewpoint coordinates to (B, m, r) by robots and (B, m, l) by objects."""


class ViewGeometry(Protocol):
    """Viewpoints of objects from the cameras of robots."""

    coordinates: slice  # the q of azimuth, elevation and range that depend on the states

    def seen(self, x: Array, o: Array, sensor: Array) -> tuple[Viewpoints, Slopes]:
        """Viewpoints of objects ``o`` (B, s) from robots ``x`` (B, s); rows of S ``sensor`` (S, p) repeat."""


@dataclass(frozen=True)
class ViewScores:
    """P(z_sem | x, o, c) of views by robots ``x`` (B, s) of objects ``o`` (B, s) with (B,) classes.

    Class -1 marks a view that is an outlier. Detections are arrays with one row each: ``feature``,
    ``feature_covariance``, ``sensor`` and ``log_outlier``.
    """

    geometry: ViewGeometry
    model: ViewpointModel
    tempering: float  # N: each density enters with power 1 / N, so N views count as one
    outliers: OutlierScores | None  # outlier distribution of scores; None: no view is an outlier

    def linearised(self, detections: Any, x: Array, o: Array, classes: Classes) -> Linearisation:
        """Residual of the feature, with the sum of the covariances of the model and of the dropout samples.

        Where views may be outliers the residual is scaled by the square root of the posterior inlier probability, which
        gives the gradient of the mixture's log density; the normaliser makes up for the difference.
        """
        viewpoints, slopes = self.geometry.seen(x, o, detections.sensor)
        prediction = self.model.predict(classes, viewpoints)
        root, log_normaliser = self._noise(prediction, detections)
        residual = self._feature_residual(prediction, detections)
        by_view = prediction.mean_jacobian[:, :, self.geometry.coordinates]
        stacked = np.empty((*residual.shape, 1 + by_view.shape[2]))
        stacked[..., 0] = residual
        stacked[..., 1:] = by_view.reshape(*residual.shape, -1)
        whitened = forward(root, stacked).reshape(len(x), residual.shape[-1], -1)
        by_robot, by_object = slopes(whitened[..., 1:])
        part = Linearisation(
            residual=whitened[..., 0],
            jacobian_robot=by_robot,
            jacobian_object=by_object,
            log_normaliser=log_normaliser,
        )
        return part if self.outliers is None else self._robust(self.outliers, part, detections, classes)

    def added_to(self, total: Array, detections: Any, x: Array, o: Array, classes: Classes) -> Array:
        """(B,) ``total`` and the log density of the features."""
        prediction = self.model.predict(classes, self.geometry.seen(x, o, detections.sensor)[0])
        root, log_normaliser = self._noise(prediction, detections)
        residual = forward(root, self._feature_residual(prediction, detections)[..., None])[..., 0]
        cost = 0.5 * squared_norms(residual).reshape(-1)
        if self.outliers is None:
            return np.asarray(total + log_normaliser - cost)
        return np.asarray(total + self._mixed(self.outliers, _classed(log_normaliser - cost, classes), detections)[0])

    def best_heading(self, detections: Any, x: Array, o: Array, classes: Classes, sigma: Array) -> tuple[Array, Array]:
        """Best headings within a window, with prior standard deviation ``sigma`` (B,) [rad] of the objects' headings.

        Wide windows are evaluated apart from narrow ones, which need fewer angles.
        """
        bound, turn = np.empty(len(x)), np.empty(len(x))
        wide = 3.0 * sigma > WIDE_WINDOW_RAD
        for rows in (np.flatnonzero(wide), np.flatnonzero(~wide)):
            if not len(rows):
                continue
            profile, angles = self.heading_profile(detections, x[rows], o[rows], classes[rows], sigma[rows])
            best = np.argmax(profile - 0.5 * (angles / np.maximum(sigma[rows], 1e-9)[:, None]) ** 2, axis=1)
            bound[rows], turn[rows] = profile.max(axis=1), angles[np.arange(len(rows)), best]
        return bound, turn

    def heading_profile(
        self, detections: Any, x: Array, o: Array, classes: Classes, sigma: Array
    ) -> tuple[Array, Array]:
        """Semantic log density (B, K) over rotations of the object by (B, K) angles, out to three sigma (B,) [rad].

        The rotation is about the object's z. The window has a least width, as rotations of the robot move views, too.
        """
        reach = np.clip(3.0 * sigma, LEAST_WINDOW_RAD, np.pi)
        count = WINDOW_ANGLES if reach.max(initial=0.0) > WIDE_WINDOW_RAD else NARROW_WINDOW_ANGLES
        turns = reach[:, None] * np.linspace(-1.0, 1.0, count)
        seen = self.geometry.seen(x, o, detections.sensor)[0]
        elevation, distance = (np.repeat(value, count) for value in (seen.elevation_rad, seen.range_m))
        around = Viewpoints((seen.azimuth_rad[:, None] - turns).ravel(), elevation, distance)
        prediction = self.model.predict(np.repeat(classes, count), around)
        number = len(detections.feature)
        turned = detections.take(np.repeat(np.arange(number), count if number > 1 else 1))
        root, log_normaliser = self._noise(prediction, turned)
        whitened = forward(root, self._feature_residual(prediction, turned)[..., None])[..., 0]
        profile = log_normaliser - 0.5 * squared_norms(whitened).reshape(-1)
        if self.outliers is not None:
            profile = self._mixed(self.outliers, profile, turned)[0]
        return profile.reshape(turns.shape), turns

    def log_outlier(self, seen: Any) -> Array | None:
        """(S,) log of the outlier share times the score's density as an outlier; None: no view is an outlier."""
        if self.outliers is None:
            return None
        return np.asarray(np.log(self.outliers.share) + seen.log_outlier / self.tempering)

    def with_outliers(self, detections: Any) -> Any:
        """Detections with the log density of each feature as an outlier."""
        if self.outliers is None or not len(detections.feature):
            return detections
        return replace(
            detections, log_outlier=self.outliers.log_density(detections.feature, detections.feature_covariance)
        )

    def _mixed(self, outliers: OutlierScores, log_inlier: Array, detections: Any) -> tuple[Array, Array]:
        """(B,) log density of the inlier-outlier mixture, and (B,) posterior inlier probability."""
        log_outlier = np.tile(detections.log_outlier / self.tempering, len(log_inlier) // len(detections.log_outlier))
        return outliers.mixed(log_inlier, log_outlier)

    def _robust(self, outliers: OutlierScores, part: Linearisation, detections: Any, classes: Classes) -> Linearisation:
        squared = squared_norms(part.residual)
        log_mixed, inlier = self._mixed(outliers, _classed(part.log_normaliser - 0.5 * squared, classes), detections)
        share = np.sqrt(inlier)[:, None]
        return Linearisation(
            residual=share * part.residual,
            jacobian_robot=share[..., None] * part.jacobian_robot,
            jacobian_object=share[..., None] * part.jacobian_object,
            log_normaliser=log_mixed + 0.5 * inlier * squared,
        )

    def _noise(self, prediction: Prediction, detections: Any) -> tuple[Array, Array]:
        """Root of the tempered residual covariance, and (B,) log normaliser.

        The roots are (B / S, S, F, F), or (1, S, F, F) where the model's covariance is constant. The covariance S is
        that of the model and of the dropout samples; N(z; h, S)^(1 / N) has residuals as under N S and the N-th part of
        log N(h; h, S): the determinant must not count fully in every view either.
        """
        predicted, count = prediction.covariance, len(detections.feature)
        by_detection = predicted[:1, None] if predicted.strides[0] == 0 else per_detection(predicted, count)
        root = cholesky(by_detection + detections.feature_covariance)
        logdet = np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(-1)
        log_peak = (-logdet - 0.5 * detections.feature.shape[1] * LOG_2PI) / self.tempering
        return np.sqrt(self.tempering) * root, broadcast_copy(log_peak, (len(predicted) // count, count)).reshape(-1)

    def _feature_residual(self, prediction: Prediction, detections: Any) -> Array:
        """(B / S, S, F) predicted mean minus feature."""
        return np.asarray(per_detection(prediction.mean, len(detections.feature)) - detections.feature)


def _classed(log_inlier: Array, classes: Classes) -> Array:
    """(B,) log inlier densities; -inf where the class is -1, an outlier."""
    return np.where(classes < 0, -np.inf, log_inlier)
