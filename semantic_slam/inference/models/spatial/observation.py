"""Range and ray (direction) of a point landmark in space, which has a position and no attitude.

With d = R_x^T (t_o - t_x) the point in the body frame, the residual is whiten [|d| - range, deviation of d from the
ray], the latter along the arc between them (:mod:`ray`). A ray alone begins at the camera, and d is then relative to
it. The state spaces give the point in the body frame and its Jacobians by robot and landmark.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import gtsam
import numpy as np

from semantic_slam.configuration import NewObjectConfiguration
from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array, squared_norms
from semantic_slam.geometry.moments import largest_sigmas
from semantic_slam.inference.models.custom_factor import Sighting, custom_factor
from semantic_slam.inference.models.observation import Classes, Linearisation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.models.point_geometry import PointGeometry
from semantic_slam.inference.models.repeated_rows import repeated_detections
from semantic_slam.inference.models.spatial.detection import SpatialDetection, SpatialDetections
from semantic_slam.inference.models.spatial.gate import least_cost
from semantic_slam.inference.models.spatial.range_prior import RangePrior
from semantic_slam.inference.models.spatial.ray import distances, off_axis, polar, polar_and_slopes
from semantic_slam.inference.models.spatial.ray_factor import ray_factor, with_tail
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.kinds.spatial_poses import SpatialPoses
from semantic_slam.inference.states.kinds.spatial_positions import SpatialPositions
from semantic_slam.inference.states.spaces import Spaces

POSES_AND_POINTS_IN_SPACE = Spaces(SpatialPoses(), SpatialPositions())


@dataclass(frozen=True)
class SpatialObservation(PointGeometry):
    """The geometric observation model alone; the field of view is a cone about an axis of the body frame."""

    visibility: PlanarVisibility = field(default_factory=PlanarVisibility)
    new_objects: NewObjectConfiguration = field(default_factory=NewObjectConfiguration)
    axis: Array = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))  # (3,) of the cone, of length 1
    ray_tail: float = 0.0  # scale of the Cauchy loss of a ray alone, in standard deviations; 0: none

    _newest: list[tuple[Sequence[SpatialDetection], SpatialDetections]] = field(
        default_factory=list, init=False, repr=False, compare=False
    )

    spaces = POSES_AND_POINTS_IN_SPACE

    def distance(self, point: Array) -> Array:
        return distances(point)

    def collect(self, detections: Sequence[SpatialDetection]) -> SpatialDetections:
        """Detections as arrays; cached, as one hypothesis after the other asks for the same ones."""
        if not self._newest or self._newest[0][0] is not detections:
            self._newest[:] = [(detections, self._collected(detections))]
        return self._newest[0][1]

    def _collected(self, detections: Sequence[SpatialDetection]) -> SpatialDetections:
        return SpatialDetections.of(detections)

    def geometry(self, detections: SpatialDetections, x: Array, o: Array) -> Linearisation:
        """Residual of the range and of the ray."""
        detections = repeated_detections(detections, len(x))
        relative = self.spaces.relative_position(x, o)
        point = relative.point - detections.origin
        off, slopes = polar_and_slopes(point, detections.ray, detections.basis)
        by_point = detections.whiten @ slopes
        return Linearisation(
            residual=_residual(detections, off),
            jacobian_robot=by_point @ relative.by_robot,
            jacobian_object=by_point @ relative.by_landmark,
            log_normaliser=detections.log_normaliser.copy(),
        )

    def log_likelihood(self, detections: SpatialDetections, x: Array, o: Array, classes: Classes | None) -> Array:
        """(B,) log density without its Jacobians."""
        detections = repeated_detections(detections, len(x))
        point = self._seen(x, o) - detections.origin
        off = _residual(detections, polar(point, detections.ray, detections.basis))
        return np.asarray(detections.log_normaliser - 0.5 * squared_norms(off))

    @property
    def sees_everywhere(self) -> bool:
        """Whether the visibility has no limits."""
        return not self.visibility.is_limited

    def log_visibility(self, x: Array, o: Array, *, soft: bool) -> Array:
        """P(beta | x, o) of Eq. 4.18."""
        point = self._seen(x, o)
        return self.visibility.log_probability(distances(point), off_axis(point, self.axis), soft=soft)

    def bearing_sigma(self, x: Array, o: Array, covariance: Array, charts: Array) -> Array:
        """Standard deviation of the direction, or of the robot's attitude, whichever is larger.

        A robot anywhere on a ring about a landmark sees other objects near that landmark in much the same direction,
        but at another distance: with so much rotation no linearisation shows this.
        """
        robot = charts[:, se3.ROTATION, : self.spaces.layout.robot]
        known = covariance[:, : self.spaces.layout.robot, : self.spaces.layout.robot]
        attitude = largest_sigmas(robot @ known @ np.swapaxes(robot, 1, 2))
        return np.maximum(super().bearing_sigma(x, o, covariance, charts), attitude)

    def robot_start(self, detections: SpatialDetections, x: Array, o: Array) -> Array:
        """Keep the attitude, and move to where the point is seen as measured; stay in place for a ray alone."""
        detections, start = repeated_detections(detections, len(x)), x.copy()
        seen = detections.range_m[:, None] * detections.ray
        placed = self.spaces.landmark.position(o) - self.spaces.robot.displacement(x, seen, x[:, :3])
        start[:, :3] = np.where(detections.has_range[:, None], placed, x[:, :3])
        return start

    def turned_start(self, detections: SpatialDetections, x: Array, first: Array, second: Array) -> Array:
        """Keep roll and pitch, take the yaw that fits the direction from point to point, and the mean of the positions.

        The robot stays in place where one of them is a ray alone.
        """
        if not detections.has_range.all():
            return x
        seen = detections.range_m[:, None] * detections.ray
        apart, wanted = so3.rotated(x[:, 3:], seen[1] - seen[0]), second - first
        yaw = np.zeros((len(x), 3))
        yaw[:, 2] = np.arctan2(wanted[:, 1], wanted[:, 0]) - np.arctan2(apart[:, 1], apart[:, 0])
        turn = so3.product(so3.exp(yaw), x[:, 3:])
        place = 0.5 * (first + second - so3.rotated(turn, seen[0] + seen[1]))
        return np.concatenate([place, turn], axis=1)

    def object_prior(self, detection: SpatialDetection, x: Array) -> GaussianPrior:
        """Prior at the measured position; along a ray alone, the prior of the range."""
        return self.object_priors([detection], x)[0]

    def object_priors(self, detections: Sequence[SpatialDetection], x: Array) -> list[GaussianPrior]:
        """:meth:`object_prior` of each detection, all at once."""
        alone = [own for own in detections if not own.has_range]
        rays, sensors = (np.array(own).reshape(-1, 3) for own in ([d.ray for d in alone], [d.origin for d in alone]))
        along = iter(RangePrior.of_rays([own.log_range for own in alone], rays, sensors, x))
        return [self._prior_at_range(own, x) if own.has_range else next(along) for own in detections]

    def _prior_at_range(self, detection: SpatialDetection, x: Array) -> GaussianPrior:
        place = self.spaces.robot.displacement(x, detection.range_m * detection.ray, np.zeros(3))
        return GaussianPrior(place, self.new_objects.sigma_position_m**2 * np.eye(3))

    def geometry_factor(self, detection: SpatialDetection, keys: tuple[int, int]) -> Any:
        """GTSAM's own factor where the ray's error is isotropic, as it rotates the plane across the ray with the point.

        Otherwise a custom factor: GTSAM's would depend on where it puts the axes of that plane.
        """
        if detection.is_round and not detection.has_range and not detection.origin.any():
            return gtsam.BearingFactor3D(*keys, detection.direction, with_tail(detection.noise, self.ray_tail))
        if detection.is_round and detection.has_range:
            return gtsam.BearingRangeFactor3D(*keys, detection.direction, detection.range_m, detection.noise)
        return (
            self._custom_factor(detection, keys) if detection.has_range else ray_factor(detection, keys, self.ray_tail)
        )

    def _custom_factor(self, detection: SpatialDetection, keys: tuple[int, int]) -> Any:
        collected = self.collect([detection])
        linearise, rows = (lambda x, o: self.geometry(collected, x, o)), slice(0, 3)
        return custom_factor(self.spaces, linearise, Sighting(detection, keys), rows, 3)

    def least_cost(
        self, detections: SpatialDetections, x: Array, covariance: Array, o: Array, sigmas: Array
    ) -> tuple[Array, float]:
        """The larger of the least costs by range and by ray, each minimised over position errors."""
        robots = np.broadcast_to(x[:, None], (*o.shape[:2], x.shape[-1]))
        return least_cost(detections, covariance, self._seen(robots, o), sigmas)

    def _seen(self, x: Array, o: Array) -> Array:
        return self.spaces.robot.turned_back(x, self.spaces.landmark.position(o) - x[..., :3])


def _residual(detections: SpatialDetections, off: Array) -> Array:
    """(B, 3) whitened residual of range and ray, from ranges and deviations ``off`` (B, 3)."""
    residual = off.copy()
    residual[:, 0] -= detections.range_m
    return np.asarray((detections.whiten @ residual[..., None])[..., 0])
