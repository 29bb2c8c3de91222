"""Class scores of views: their density under the class models, by the side that the object is seen from (Eq. 4.2)."""

from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.geometry.arrays import Array, broadcast_copy, squared_norms
from semantic_slam.geometry.small_matrices import cholesky, forward
from semantic_slam.inference.models.observation import Classes, Linearisation
from semantic_slam.inference.models.planar.frames import camera_in_object
from semantic_slam.inference.models.planar.polar import polar, polar_jacobian
from semantic_slam.inference.models.planar.rows import per_detection, repeated
from semantic_slam.inference.models.planar.slopes import by_camera, by_pose
from semantic_slam.inference.models.planar_detection import LOG_2PI, PlanarDetections
from semantic_slam.viewpoint.model import Prediction, ViewpointModel, Viewpoints
from semantic_slam.viewpoint.outliers import OutlierScores

LEAST_WINDOW_RAD = 0.6
"""Half the range of azimuths about a mode that is searched at least."""
WINDOW_ANGLES, NARROW_WINDOW_ANGLES, WIDE_WINDOW_RAD = 25, 13, 1.2
"""Azimuths looked at, fewer where half the range is not wide."""


@dataclass(frozen=True)
class ViewScores:
    """P(z_sem | x, o, c) of views by robots ``x`` (B, 3) of objects ``o`` (B, 3) of (B,) classes.

    Of class -1 is a view that is an outlier.
    """

    model: ViewpointModel
    tempering: float  # N: so many views tell as much as one, each density enters with the power 1 / N
    outliers: OutlierScores | None  # what a score may be besides; None: no view is an outlier

    def linearised(self, detections: PlanarDetections, x: Array, o: Array, classes: Classes) -> Linearisation:
        """Residual of the feature, its covariance being that of the model and of the dropout passes.

        Where views may be outliers the residual counts with the square root of the posterior that this one is none,
        which has the gradient of the mixture's log density; the normaliser makes up for the rest.
        """
        v = camera_in_object(x, o, repeated(detections.sensor, len(x)))
        distance, azimuth = polar(v)
        prediction = self._predict(classes, azimuth, distance)
        root, log_normaliser = self._noise(prediction, detections)
        residual = self._feature_residual(prediction, detections)
        stacked = np.empty((*residual.shape, 3))
        stacked[..., 0] = residual
        stacked[..., 1:] = prediction.mean_jacobian[:, :, ::2].reshape(*residual.shape, 2)
        whitened = forward(root, stacked).reshape(len(x), residual.shape[-1], 3)
        radial, turn = polar_jacobian(v, distance)
        by_view = whitened[..., 1:2] * turn[:, None]
        by_view += whitened[..., 2:] * radial[:, None]
        by_robot = by_camera(by_view, x[:, 2] - o[:, 2], detections.sensor)
        part = Linearisation(
            residual=whitened[..., 0],
            jacobian_robot=by_robot,
            jacobian_object=by_pose(by_view, v),
            log_normaliser=log_normaliser,
        )
        return part if self.outliers is None else self._robust(self.outliers, part, detections, classes)

    def added_to(self, total: Array, detections: PlanarDetections, x: Array, o: Array, classes: Classes) -> Array:
        """(B,) ``total`` and the log density of the features."""
        distance, azimuth = polar(camera_in_object(x, o, repeated(detections.sensor, len(x))))
        prediction = self._predict(classes, azimuth, distance)
        root, log_normaliser = self._noise(prediction, detections)
        residual = forward(root, self._feature_residual(prediction, detections)[..., None])[..., 0]
        cost = 0.5 * squared_norms(residual).reshape(-1)
        if self.outliers is None:
            return np.asarray(total + log_normaliser - cost)
        return np.asarray(total + self._mixed(self.outliers, _classed(log_normaliser - cost, classes), detections)[0])

    def best_heading(
        self, detections: PlanarDetections, x: Array, o: Array, classes: Classes, sigma: Array
    ) -> tuple[Array, Array]:
        """Best headings over a window of them, the objects' prior deviating by ``sigma`` (B,) [rad].

        Wide windows are looked at apart from narrow ones, which need fewer angles.
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
        self, detections: PlanarDetections, x: Array, o: Array, classes: Classes, sigma: Array
    ) -> tuple[Array, Array]:
        """Semantic log density (B, K) when the object is turned by (B, K) angles, out to three sigma (B,) [rad].

        Less than a narrow window is always looked at: the robot's heading moves the viewpoint, too.
        """
        reach = np.clip(3.0 * sigma, LEAST_WINDOW_RAD, np.pi)
        count = WINDOW_ANGLES if reach.max(initial=0.0) > WIDE_WINDOW_RAD else NARROW_WINDOW_ANGLES
        turns = reach[:, None] * np.linspace(-1.0, 1.0, count)
        distance, azimuth = polar(camera_in_object(x, o, detections.sensor))
        prediction = self._predict(
            np.repeat(classes, count), (azimuth[:, None] - turns).ravel(), np.repeat(distance, count)
        )
        turned = detections.take(
            np.repeat(np.arange(len(detections.range_m)), count if len(detections.range_m) > 1 else 1)
        )
        root, log_normaliser = self._noise(prediction, turned)
        whitened = forward(root, self._feature_residual(prediction, turned)[..., None])[..., 0]
        profile = log_normaliser - 0.5 * squared_norms(whitened).reshape(-1)
        if self.outliers is not None:
            profile = self._mixed(self.outliers, profile, turned)[0]
        return profile.reshape(turns.shape), turns

    def log_outlier(self, seen: PlanarDetections) -> Array | None:
        """(S,) log of the share of outliers times the density of the score as one; None: no view is an outlier."""
        if self.outliers is None:
            return None
        return np.asarray(np.log(self.outliers.share) + seen.log_outlier / self.tempering)

    def with_outliers(self, detections: PlanarDetections) -> PlanarDetections:
        """Detections with the log density of each feature as an outlier."""
        if self.outliers is None or not len(detections.feature):
            return detections
        return replace(
            detections, log_outlier=self.outliers.log_density(detections.feature, detections.feature_covariance)
        )

    def _mixed(self, outliers: OutlierScores, log_inlier: Array, detections: PlanarDetections) -> tuple[Array, Array]:
        """(B,) log density of features that may be outliers, and (B,) posterior that they are none."""
        log_outlier = np.tile(detections.log_outlier / self.tempering, len(log_inlier) // len(detections.log_outlier))
        return outliers.mixed(log_inlier, log_outlier)

    def _robust(
        self, outliers: OutlierScores, part: Linearisation, detections: PlanarDetections, classes: Classes
    ) -> Linearisation:
        squared = squared_norms(part.residual)
        log_mixed, inlier = self._mixed(outliers, _classed(part.log_normaliser - 0.5 * squared, classes), detections)
        share = np.sqrt(inlier)[:, None]
        return Linearisation(
            residual=share * part.residual,
            jacobian_robot=share[..., None] * part.jacobian_robot,
            jacobian_object=share[..., None] * part.jacobian_object,
            log_normaliser=log_mixed + 0.5 * inlier * squared,
        )

    def _noise(self, prediction: Prediction, detections: PlanarDetections) -> tuple[Array, Array]:
        """Root of the covariance that the residual counts with, and (B,) log normaliser.

        The roots are (B / S, S, F, F), or (1, S, F, F) where the model's covariance is the same everywhere.
        The covariance S is that of the model and of the dropout passes; N(z; h, S)^(1 / N) has residuals as under N S
        and the N-th part of log N(h; h, S): the determinant must not count fully in every view either.
        """
        predicted, count = prediction.covariance, len(detections.feature)
        by_detection = predicted[:1, None] if predicted.strides[0] == 0 else per_detection(predicted, count)
        root = cholesky(by_detection + detections.feature_covariance)
        logdet = np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(-1)
        log_peak = (-logdet - 0.5 * detections.feature.shape[1] * LOG_2PI) / self.tempering
        return np.sqrt(self.tempering) * root, broadcast_copy(log_peak, (len(predicted) // count, count)).reshape(-1)

    def _feature_residual(self, prediction: Prediction, detections: PlanarDetections) -> Array:
        """(B / S, S, F) of the mean against the features."""
        return per_detection(prediction.mean, len(detections.feature)) - detections.feature

    def _predict(self, classes: Classes, azimuth: Array, distance: Array) -> Prediction:
        return self.model.predict(classes, Viewpoints(azimuth, np.zeros_like(azimuth), distance))


def _classed(log_inlier: Array, classes: Classes) -> Array:
    """(B,) log densities, none where the view is an outlier, which is class -1."""
    return np.where(classes < 0, -np.inf, log_inlier)
