"""Range and bearing of a point landmark in the plane, which has a position and no heading.

With d the point in the body frame, relative to the detection's origin there, the residual is whiten [|d| - range, angle
of d - bearing]. The state spaces give the point in the body frame and its Jacobians by robot and landmark.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from semantic_slam.configuration import NewObjectConfiguration
from semantic_slam.geometry.arrays import Array, squared_norms
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.models.custom_factor import Sighting
from semantic_slam.inference.models.observation import Classes, Linearisation
from semantic_slam.inference.models.planar.detection import PlanarDetection, PlanarDetections
from semantic_slam.inference.models.planar.factors import bearing_factor, point_range_factor
from semantic_slam.inference.models.planar.gate import least_cost
from semantic_slam.inference.models.planar.polar import polar, polar_jacobian
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.models.point_geometry import PointGeometry
from semantic_slam.inference.models.repeated_rows import repeated_detections
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.kinds.planar_poses import PlanarPoses
from semantic_slam.inference.states.kinds.planar_positions import PlanarPositions
from semantic_slam.inference.states.spaces import Spaces

POSES_AND_POINTS = Spaces(PlanarPoses(), PlanarPositions())


@dataclass(frozen=True)
class PointObservation(PointGeometry):
    """The geometric observation model alone, in the plane."""

    visibility: PlanarVisibility = field(default_factory=PlanarVisibility)
    new_objects: NewObjectConfiguration = field(default_factory=NewObjectConfiguration)

    spaces = POSES_AND_POINTS

    def distance(self, point: Array) -> Array:
        return polar(point)[0]

    def collect(self, detections: Sequence[PlanarDetection]) -> PlanarDetections:
        """Detections as arrays."""
        return PlanarDetections.of(detections)

    def geometry(self, detections: PlanarDetections, x: Array, o: Array) -> Linearisation:
        """Residual of [range, bearing]; the range's is 0 for a bearing alone."""
        detections = repeated_detections(detections, len(x))
        relative = self.spaces.relative_position(x, o)
        d = relative.point - detections.origin
        distance, _ = polar(d)
        by_point = detections.whiten @ np.stack(polar_jacobian(d, distance), axis=-2)
        by_robot, by_landmark = by_point @ relative.by_robot, by_point @ relative.by_landmark
        return Linearisation(
            residual=_residual(detections, d),
            jacobian_robot=by_robot,
            jacobian_object=by_landmark,
            log_normaliser=detections.log_normaliser.copy(),
        )

    def log_likelihood(self, detections: PlanarDetections, x: Array, o: Array, classes: Classes | None) -> Array:
        """(B,) log density without its Jacobians."""
        detections = repeated_detections(detections, len(x))
        residual = _residual(detections, self.spaces.relative_position(x, o).point - detections.origin)
        return np.asarray(detections.log_normaliser - 0.5 * squared_norms(residual))

    @property
    def sees_everywhere(self) -> bool:
        """Whether the visibility has no limits."""
        return not self.visibility.is_limited

    def log_visibility(self, x: Array, o: Array, *, soft: bool) -> Array:
        """P(beta | x, o) of Eq. 4.18."""
        return self.visibility.log_probability(*polar(self.spaces.relative_position(x, o).point), soft=soft)

    def robot_start(self, detections: PlanarDetections, x: Array, o: Array) -> Array:
        """Keep the heading, and move to where the point is seen as measured."""
        detections, start = repeated_detections(detections, len(x)), x.copy()
        ahead = self.spaces.robot.displacement(x, _measured(detections.range_m, detections.bearing_rad), x[:, :2])
        start[:, :2] = np.where(detections.has_range[:, None], o - ahead, x[:, :2])
        return start

    def object_prior(self, detection: PlanarDetection, x: Array) -> GaussianPrior:
        """Prior at the measured position; without a range, as uncertain as the assumed range."""
        new = self.new_objects
        distance = detection.range_m if detection.has_range else new.range_m
        sigma_m = new.sigma_position_m if detection.has_range else min(new.range_m, new.sigma_position_m)
        point = detection.origin + _measured(np.array(distance), np.array(detection.bearing_rad))
        return GaussianPrior(self.spaces.robot.displacement(x, point, np.zeros(2)), sigma_m**2 * np.eye(2))

    def geometry_factor(self, detection: PlanarDetection, keys: tuple[int, int]) -> Any:
        """Range and bearing; a bearing alone, from a camera off the body's origin, is a custom factor."""
        if detection.has_range:
            return point_range_factor(detection, keys)
        collected = self.collect([detection])
        return bearing_factor(self.spaces, lambda x, o: self.geometry(collected, x, o), Sighting(detection, keys))

    def least_cost(
        self, detections: PlanarDetections, x: Array, covariance: Array, o: Array, sigmas: Array
    ) -> tuple[Array, float]:
        """The larger of the least costs by range and by bearing, each minimised over position errors."""
        robots = np.broadcast_to(x[:, None], (*o.shape[:2], x.shape[-1]))
        body = self.spaces.relative_position(robots, o).point
        return least_cost(detections, covariance, np.repeat(body[:, None], len(detections.range_m), axis=1), sigmas)


def _residual(detections: PlanarDetections, d: Array) -> Array:
    """(B, 2) whitened residual of range and bearing of points ``d`` in the body frame."""
    distance, bearing = polar(d)
    off = np.stack([distance - detections.range_m, wrap_angle(bearing - detections.bearing_rad)], axis=-1)
    return np.asarray((detections.whiten @ off[..., None])[..., 0])


def _measured(range_m: Array, bearing_rad: Array) -> Array:
    """(..., 2) measured points in the body frame [m], from range and bearing."""
    return np.stack([range_m * np.cos(bearing_rad), range_m * np.sin(bearing_rad)], axis=-1)
