"""Range, bearing and viewpoint-dependent semantics of an object in the plane.

With d = R_x^T (t_o - t_x) the object in the body frame and v = R_o^T (t_x + R_x s - t_o) the camera in the
object's frame, range and bearing are those of d, the viewpoint's azimuth and range those of v. Right
perturbations give dd/dx = [-I, -S d], dd/do = [R_x^T R_o, 0], dv/dx = R_o^T R_x [I, S s], dv/do = [-I, -S v],
where S turns by a quarter.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from semantic_slam.configuration import NewObjectConfiguration
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array, broadcast_copy, squared_norms
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.geometry.se2 import sine_cosine
from semantic_slam.geometry.small_matrices import cholesky, forward
from semantic_slam.inference.models.observation import Classes, Linearisation
from semantic_slam.inference.models.planar_detection import LOG_2PI, PlanarDetection, PlanarDetections
from semantic_slam.inference.models.planar_factors import bearing_factor, range_factor
from semantic_slam.inference.models.planar_gate import least_cost
from semantic_slam.inference.models.polar import polar, polar_jacobian
from semantic_slam.inference.models.visibility import PlanarVisibility
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.planar_poses import PlanarPoses
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.viewpoint.model import Prediction, ViewpointModel, Viewpoints
from semantic_slam.viewpoint.outliers import OutlierScores

POSES = Spaces.same(PlanarPoses())
LEAST_WINDOW_RAD = 0.6
"""Half the range of azimuths about a mode that is searched at least."""
WINDOW_ANGLES, NARROW_WINDOW_ANGLES, WIDE_WINDOW_RAD = 25, 13, 1.2
"""Azimuths looked at, fewer where half the range is not wide."""


class PlanarObservation:
    """Geometric range-bearing likelihood times the class model of Eq. 4.2 (``model`` None: geometry alone)."""

    def __init__(
        self,
        model: ViewpointModel | None,
        visibility: PlanarVisibility,
        new_objects: NewObjectConfiguration | None = None,
        tempering: float = 1.0,
        outliers: OutlierScores | None = None,
    ):
        """``tempering`` N: so many views tell as much as one, each density enters with the power 1 / N.

        ``outliers``: what a view's score may be besides what the class model says; None: no view is an outlier.
        """
        self.model = model
        self.outliers = outliers
        self.tempering = tempering
        self.visibility = visibility
        self.new_objects = new_objects or NewObjectConfiguration()
        self.num_classes = len(model.class_names) if model is not None else 0
        self._collected: tuple[Sequence[PlanarDetection], PlanarDetections] | None = None

    def collect(self, detections: Sequence[PlanarDetection]) -> PlanarDetections:
        """Detections as arrays; the same ones are asked for by one hypothesis after the other."""
        if self._collected is None or self._collected[0] is not detections:
            self._collected = detections, self._with_outliers(PlanarDetections.of(detections))
        return self._collected[1]

    def geometry(self, detections: PlanarDetections, x: Array, o: Array) -> Linearisation:
        """Residual of [range, bearing], the range's 0 where there is only a bearing."""
        rows = _Rows.of(detections, x, o)
        body, d, distance, whitened = rows.polar_residual()
        by_point = rows.by_polar(d, distance)
        log_normaliser = broadcast_copy(detections.log_normaliser, distance.shape)
        turn = sine_cosine(rows.o[..., 2] - rows.x[..., 2])
        return Linearisation(
            residual=whitened.reshape(-1, 2),
            jacobian_robot=by_pose(by_point, body).reshape(-1, 2, 3),
            jacobian_object=by_position(by_point, *turn).reshape(-1, 2, 3),
            log_normaliser=log_normaliser.reshape(-1),
        )

    def semantics(self, detections: PlanarDetections, x: Array, o: Array, classes: Classes) -> Linearisation:
        """Residual of the feature under Eq. 4.2, its covariance being that of the model and of the dropout passes.

        Where views may be outliers the residual counts with the square root of the posterior that this one is none,
        which has the gradient of the mixture's log density; the normaliser makes up for the rest.
        """
        v = camera_in_object(x, o, _repeated(detections.sensor, len(x)))
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

    def log_likelihood(self, detections: PlanarDetections, x: Array, o: Array, classes: Classes | None) -> Array:
        """(B,) log density without its slopes."""
        rows = _Rows.of(detections, x, o)
        whitened = rows.polar_residual()[3]
        total = (detections.log_normaliser - 0.5 * (whitened[..., 0] ** 2 + whitened[..., 1] ** 2)).reshape(-1)
        if classes is None:
            return np.asarray(total)
        distance, azimuth = polar(camera_in_object(x, o, _repeated(detections.sensor, len(x))))
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
        repeated = detections.take(
            np.repeat(np.arange(len(detections.range_m)), count if len(detections.range_m) > 1 else 1)
        )
        root, log_normaliser = self._noise(prediction, repeated)
        whitened = forward(root, self._feature_residual(prediction, repeated)[..., None])[..., 0]
        profile = log_normaliser - 0.5 * squared_norms(whitened).reshape(-1)
        if self.outliers is not None:
            profile = self._mixed(self.outliers, profile, repeated)[0]
        return profile.reshape(turns.shape), turns

    def log_outlier(self, seen: PlanarDetections) -> Array | None:
        """(S,) log of the share of outliers times the density of the score as one; None: no view is an outlier."""
        if self.outliers is None:
            return None
        return np.asarray(np.log(self.outliers.share) + seen.log_outlier / self.tempering)

    def log_visibility(self, x: Array, o: Array, *, soft: bool) -> Array:
        """P(beta | x, o) of Eq. 4.18."""
        distance, bearing = polar(object_in_body(x, o))
        return self.visibility.log_probability(distance, bearing, soft=soft)

    def robot_start(self, detections: PlanarDetections, x: Array, o: Array) -> Array:
        """Keep the heading, stand where the object is seen as measured."""
        direction = x[:, 2] + detections.bearing_rad
        start = x.copy()
        start[:, 0] = np.where(detections.has_range, o[:, 0] - detections.range_m * np.cos(direction), x[:, 0])
        start[:, 1] = np.where(detections.has_range, o[:, 1] - detections.range_m * np.sin(direction), x[:, 1])
        return start

    def object_prior(self, detection: PlanarDetection, x: Array) -> GaussianPrior:
        """Prior where the detection points, heading as the robot's; without depth as uncertain as the guess is far."""
        new = self.new_objects
        distance = detection.range_m if detection.has_range else new.range_m
        sigma_m = new.sigma_position_m if detection.has_range else min(new.range_m, new.sigma_position_m)
        origin_x, origin_y = detection.origin.tolist()
        ahead, aside = math.cos(detection.bearing_rad), math.sin(detection.bearing_rad)
        mean = se2.compose(x, np.array([origin_x + distance * ahead, origin_y + distance * aside, 0.0]))
        return GaussianPrior(mean, np.diag([sigma_m, sigma_m, new.sigma_heading_rad]) ** 2)

    def geometry_factor(self, detection: PlanarDetection, keys: tuple[int, int]) -> Any:
        """Range and bearing; a bearing alone, from a camera off the body's origin, is a custom factor."""
        if detection.has_range:
            return range_factor(detection, keys)
        collected = self.collect([detection])
        return bearing_factor(POSES, lambda x, o: self.geometry(collected, x, o), keys)

    def bearing_sigma(self, x: Array, o: Array, covariance: Array, charts: Array) -> Array:
        """Standard deviation of the bearing, from the covariance of the object in the body frame."""
        d, turn = object_in_body(x, o), o[:, 2] - x[:, 2]
        jacobian = np.zeros((len(x), 2, 6))
        jacobian[:, 0, 0] = jacobian[:, 1, 1] = -1.0
        jacobian[:, 0, 2], jacobian[:, 1, 2] = d[:, 1], -d[:, 0]
        jacobian[:, 0, 3] = jacobian[:, 1, 4] = np.cos(turn)
        jacobian[:, 1, 3] = np.sin(turn)
        jacobian[:, 0, 4] = -jacobian[:, 1, 3]
        jacobian = jacobian @ charts
        spread = ((jacobian @ covariance) * jacobian).sum(axis=(1, 2))
        return np.asarray(np.sqrt(np.maximum(spread, 0.0)) / polar(d)[0])

    def least_cost(
        self, detections: PlanarDetections, x: Array, covariance: Array, o: Array, sigmas: Array
    ) -> tuple[Array, float]:
        """Range and bearing each on its own, at the deviation that makes it cheapest."""
        shape = (len(x), len(detections.range_m), o.shape[1], 3)
        body = object_in_body(np.broadcast_to(x[:, None, None], shape), np.broadcast_to(o[:, None], shape))
        return least_cost(detections, covariance, body, sigmas)

    def view_change(self, before: Array, now: Array) -> Array:
        """Change of the view's direction or heading [rad], from poses of objects in the robot's frame."""
        distance, _ = polar(before)
        moved = np.hypot(now[:, 0] - before[:, 0], now[:, 1] - before[:, 1])
        return np.maximum(moved / distance, np.abs(wrap_angle(now[:, 2] - before[:, 2])))

    def _with_outliers(self, detections: PlanarDetections) -> PlanarDetections:
        if self.outliers is None or self.model is None or not len(detections.feature):
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
        by_detection = predicted[:1, None] if predicted.strides[0] == 0 else _per_detection(predicted, count)
        root = cholesky(by_detection + detections.feature_covariance)
        logdet = np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(-1)
        log_peak = (-logdet - 0.5 * detections.feature.shape[1] * LOG_2PI) / self.tempering
        return np.sqrt(self.tempering) * root, broadcast_copy(log_peak, (len(predicted) // count, count)).reshape(-1)

    def _feature_residual(self, prediction: Prediction, detections: PlanarDetections) -> Array:
        """(B / S, S, F) of the mean against the features."""
        return _per_detection(prediction.mean, len(detections.feature)) - detections.feature

    def _predict(self, classes: Classes, azimuth: Array, distance: Array) -> Prediction:
        assert self.model is not None
        return self.model.predict(classes, Viewpoints(azimuth, np.zeros_like(azimuth), distance))


@dataclass(frozen=True)
class _Rows:
    """Robots and objects (B / S, S, 3) beside S detections, which repeat."""

    detections: PlanarDetections
    x: Array
    o: Array

    @classmethod
    def of(cls, detections: PlanarDetections, x: Array, o: Array) -> "_Rows":
        count = len(detections.range_m)
        return cls(detections, _per_detection(x, count), _per_detection(o, count))

    def polar_residual(self) -> tuple[Array, Array, Array, Array]:
        """(..., 2) object in the body frame and from the detection's origin, its (...,) distance, (..., 2) residual."""
        detections, body = self.detections, object_in_body(self.x, self.o)
        d = body - detections.origin
        distance, bearing = polar(d)
        by_range, turn = distance - detections.range_m, wrap_angle(bearing - detections.bearing_rad)
        whitened = np.empty(d.shape)
        whitened[..., 0] = detections.whiten[..., 0, 0] * by_range
        whitened[..., 1] = detections.whiten[..., 1, 0] * by_range + detections.whiten[..., 1, 1] * turn
        return body, d, distance, whitened

    def by_polar(self, d: Array, distance: Array) -> Array:
        """(..., 2, 2) derivative of the residual by the point ``d``."""
        radial, turn = polar_jacobian(d, distance)
        whiten = self.detections.whiten
        derivative = np.empty((*d.shape, 2))
        derivative[..., 0, :] = whiten[..., 0, :1] * radial
        derivative[..., 1, :] = whiten[..., 1, :1] * radial + whiten[..., 1, 1:] * turn
        return derivative


def object_in_body(x: Array, o: Array) -> Array:
    """(..., 2) positions of objects in the body frame."""
    sin, cos = sine_cosine(x[..., 2])
    return _turned_back(sin, cos, o[..., 0] - x[..., 0], o[..., 1] - x[..., 1])


def camera_in_object(x: Array, o: Array, sensor: Array) -> Array:
    """(B, 2) positions of the camera in the objects' frames; ``sensor`` (2,) or (B, 2) in the body frame."""
    ahead, left = x[..., 0] - o[..., 0], x[..., 1] - o[..., 1]
    if sensor.any():
        sin, cos = sine_cosine(x[..., 2])
        ahead = ahead + cos * sensor[..., 0] - sin * sensor[..., 1]
        left = left + sin * sensor[..., 0] + cos * sensor[..., 1]
    sin, cos = sine_cosine(o[..., 2])
    return _turned_back(sin, cos, ahead, left)


def camera_bearing(robot: Array, objects: Array, sensor: Array) -> Array:
    """(K,) directions in map from (K, 3) objects to the cameras of (K, 3) robots."""
    upright = objects.copy()
    upright[:, 2] = 0.0
    camera = camera_in_object(robot, upright, sensor)
    return np.asarray(np.arctan2(camera[:, 1], camera[:, 0]))


def _per_detection(values: Array, count: int) -> Array:
    """(B / S, S, ...) rows by detection of (B, ...), S being ``count``."""
    return values.reshape(len(values) // max(count, 1), count, *values.shape[1:])


def _repeated(values: Array, count: int) -> Array:
    """(S, 2) of the detections as (count, 2)."""
    shape = (count // max(len(values), 1), *values.shape)
    return broadcast_copy(values, shape).reshape(-1, *values.shape[1:])


def _classed(log_inlier: Array, classes: Classes) -> Array:
    """(B,) log densities, none where the view is an outlier, which is class -1."""
    return np.where(classes < 0, -np.inf, log_inlier)


def _turned_back(sin: Array, cos: Array, x: Array, y: Array) -> Array:
    turned = np.empty((*np.shape(x), 2))
    turned[..., 0] = cos * x + sin * y
    turned[..., 1] = cos * y - sin * x
    return turned


def by_pose(by_point: Array, point: Array) -> Array:
    """(..., m, 3) derivatives by the pose of the frame that ``point`` (..., 2) is given in: by_point [-I, -S point]."""
    derivative = np.empty((*by_point.shape[:-1], 3))
    np.negative(by_point, out=derivative[..., :2])
    derivative[..., 2] = by_point[..., 0] * point[..., None, 1] - by_point[..., 1] * point[..., None, 0]
    return derivative


def by_position(by_point: Array, sin: Array, cos: Array) -> Array:
    """(..., m, 3) derivatives by a pose of which only the position counts, turned against the frame."""
    sin, cos = sin[..., None], cos[..., None]
    derivative = np.empty((*by_point.shape[:-1], 3))
    derivative[..., 0] = by_point[..., 0] * cos + by_point[..., 1] * sin
    derivative[..., 1] = by_point[..., 1] * cos - by_point[..., 0] * sin
    derivative[..., 2] = 0.0
    return derivative


def by_camera(by_point: Array, angle: Array, sensor: Array) -> Array:
    """(B, m, 3) derivatives by the robot's pose, its camera at ``sensor``: by_point R [I, S s]."""
    derivative = by_position(by_point, *sine_cosine(angle))
    if sensor.any():
        derivative[..., 2] = _about_camera(derivative, _repeated(sensor, len(derivative)))
    return derivative


def _about_camera(by_camera: Array, sensor: Array) -> Array:
    """(B, m) derivatives by the heading of a robot whose camera is at ``sensor``: by_point R S s."""
    return np.asarray(by_camera[..., 1] * sensor[..., :1] - by_camera[..., 0] * sensor[..., 1:])
