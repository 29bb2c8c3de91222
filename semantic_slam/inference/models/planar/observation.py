"""Range, bearing and viewpoint-dependent semantics of an object in the plane.

With d = R_x^T (t_o - t_x) the object in the body frame and v = R_o^T (t_x + R_x s - t_o) the camera in the
object's frame, range and bearing are those of d, the viewpoint's azimuth and range those of v.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from semantic_slam.configuration import NewObjectConfiguration
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array, broadcast_copy
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.geometry.se2 import sine_cosine
from semantic_slam.inference.models.custom_factor import Sighting
from semantic_slam.inference.models.observation import Classes, Linearisation
from semantic_slam.inference.models.planar.detection import PlanarDetection, PlanarDetections
from semantic_slam.inference.models.planar.factors import bearing_factor, range_factor
from semantic_slam.inference.models.planar.frames import object_in_body
from semantic_slam.inference.models.planar.gate import least_cost
from semantic_slam.inference.models.planar.polar import polar
from semantic_slam.inference.models.planar.residual import MeasuredRows
from semantic_slam.inference.models.planar.slopes import by_pose, by_position
from semantic_slam.inference.models.planar.views import PlanarViews
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.models.scored_views import ScoredViews
from semantic_slam.inference.models.view_scores import ViewScores
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.kinds.planar_objects import PlanarObjects
from semantic_slam.inference.states.kinds.planar_poses import PlanarPoses
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.viewpoint.model import ViewpointModel
from semantic_slam.viewpoint.outliers import OutlierScores

POSES_IN_PLANE = Spaces(PlanarPoses(), PlanarObjects())


class PlanarObservation(ScoredViews):
    """Geometric range-bearing likelihood times the class model of Eq. 4.2 (``model`` None: geometry alone)."""

    def __init__(
        self,
        model: ViewpointModel | None,
        visibility: PlanarVisibility,
        new_objects: NewObjectConfiguration | None = None,
        tempering: float = 1.0,
        outliers: OutlierScores | None = None,
    ):
        """``tempering`` N: each density enters with power 1 / N, so that N views count as one.

        ``outliers``: distribution of outlier scores beside the class model; None: no view is an outlier.
        """
        self.scores = ViewScores(PlanarViews(), model, tempering, outliers) if model is not None else None
        self.visibility = visibility
        self.new_objects = new_objects or NewObjectConfiguration()
        self._collected: tuple[Sequence[PlanarDetection], PlanarDetections] | None = None

    def collect(self, detections: Sequence[PlanarDetection]) -> PlanarDetections:
        """Detections as arrays; cached, as one hypothesis after the other asks for the same ones."""
        if self._collected is None or self._collected[0] is not detections:
            found = PlanarDetections.of(detections)
            self._collected = detections, found if self.scores is None else self.scores.with_outliers(found)
        return self._collected[1]

    def geometry(self, detections: PlanarDetections, x: Array, o: Array) -> Linearisation:
        """Residual of [range, bearing]; the range's is 0 for a bearing alone."""
        rows = MeasuredRows.of(detections, x, o)
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

    def log_likelihood(self, detections: PlanarDetections, x: Array, o: Array, classes: Classes | None) -> Array:
        """(B,) log density without its Jacobians."""
        whitened = MeasuredRows.of(detections, x, o).polar_residual()[3]
        total = (detections.log_normaliser - 0.5 * (whitened[..., 0] ** 2 + whitened[..., 1] ** 2)).reshape(-1)
        return np.asarray(total) if classes is None else self._view_scores.added_to(total, detections, x, o, classes)

    @property
    def sees_everywhere(self) -> bool:
        """Whether the visibility has no limits."""
        return not self.visibility.is_limited

    def log_visibility(self, x: Array, o: Array, *, soft: bool) -> Array:
        """P(beta | x, o) of Eq. 4.18."""
        distance, bearing = polar(object_in_body(x, o))
        return self.visibility.log_probability(distance, bearing, soft=soft)

    def robot_start(self, detections: PlanarDetections, x: Array, o: Array) -> Array:
        """Keep the heading, and move to where the object is seen as measured."""
        direction = x[:, 2] + detections.bearing_rad
        start = x.copy()
        start[:, 0] = np.where(detections.has_range, o[:, 0] - detections.range_m * np.cos(direction), x[:, 0])
        start[:, 1] = np.where(detections.has_range, o[:, 1] - detections.range_m * np.sin(direction), x[:, 1])
        return start

    def object_prior(self, detection: PlanarDetection, x: Array) -> GaussianPrior:
        """Prior at the measured position, heading as the robot's; without a range, as wide as the assumed range."""
        new = self.new_objects
        distance = detection.range_m if detection.has_range else new.range_m
        sigma_m = new.sigma_position_m if detection.has_range else min(new.range_m, new.sigma_position_m)
        origin_x, origin_y = detection.origin.tolist()
        ahead, aside = math.cos(detection.bearing_rad), math.sin(detection.bearing_rad)
        mean = se2.compose(x, np.array([origin_x + distance * ahead, origin_y + distance * aside, 0.0]))
        covariance = np.zeros((3, 3))  # filled in: ``np.diag`` takes four times as long
        covariance[0, 0] = covariance[1, 1] = sigma_m * sigma_m
        covariance[2, 2] = new.sigma_heading_rad * new.sigma_heading_rad
        return GaussianPrior(mean, covariance)

    def geometry_factor(self, detection: PlanarDetection, keys: tuple[int, int]) -> Any:
        """Range and bearing; a bearing alone, from a camera off the body's origin, is a custom factor."""
        if detection.has_range:
            return range_factor(detection, keys)
        collected = self.collect([detection])
        return bearing_factor(POSES_IN_PLANE, lambda x, o: self.geometry(collected, x, o), Sighting(detection, keys))

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
        """The larger of the least costs by range and by bearing, each minimised over position errors."""
        shape = (len(x), len(detections.range_m), o.shape[1], 3)
        body = object_in_body(np.broadcast_to(x[:, None, None], shape), np.broadcast_to(o[:, None], shape))
        return least_cost(detections, covariance, body, sigmas)

    def view_change(self, before: Array, now: Array) -> Array:
        """Change of the view's direction or heading [rad], from poses of objects in the robot's frame."""
        distance, _ = polar(before)
        moved = np.hypot(now[:, 0] - before[:, 0], now[:, 1] - before[:, 1])
        return np.maximum(moved / distance, np.abs(wrap_angle(now[:, 2] - before[:, 2])))
