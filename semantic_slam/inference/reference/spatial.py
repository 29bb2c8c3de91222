"""The null model's detections in space: uniform over the volume of the sensor's region; and gravity."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.models.spatial.detection import SpatialDetection
from semantic_slam.inference.models.spatial.log_range import LogRange
from semantic_slam.inference.models.spatial.unmeasured_ranges import UnmeasuredRanges
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.open_world.spatial.births import first_detections_in_space
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.spaces import LEAST_DISTANCE_M, Spaces
from semantic_slam.inference.world.problem import Problem
from semantic_slam.viewpoint.size_model import log_density_of_any


@dataclass(kw_only=True)
class SpatialPlaces:
    """Uniform :class:`EvenPlaces` in space: a range r has the density r^2 / volume, and rays alone are uniform.

    Sizes of boxes are those of things of any size. Gravity is measured by a robot that dead reckons with it.
    """

    region: SpatialRegion
    volume_m3: float
    solid_angle: float  # [rad^2]
    spaces: Spaces
    model: ObservationModel
    has_sizes: bool  # whether sizes of boxes are evidence
    anywhere: LogRange  # prior of a range that was not measured
    robot: GaussianPrior = field(repr=False)  # by odometry and gravity, after the newest keyframe

    @classmethod
    def of(cls, configuration: Configuration, problem: Problem, *, is_open: bool) -> Self:
        """Where an open world expects detections; in a closed one, the cone that is visible.

        Where a closed world limits no range, the region ends where perception and clutter both end.
        """
        region, limits = SpatialRegion.of(configuration.open_world), configuration.visibility
        volume, solid_angle = region.volume_m3, region.solid_angle
        if not is_open:
            half = 0.5 * limits.field_of_view_rad or np.pi
            solid_angle = 2.0 * np.pi * float(1.0 - np.cos(half))
            reach = limits.max_range_m or max(configuration.perception.max_depth_m, region.max_range_m)
            volume = solid_angle * reach**3 / 3.0
        return cls(
            region=region,
            volume_m3=volume,
            solid_angle=solid_angle,
            spaces=problem.spaces,
            model=problem.model,
            has_sizes=configuration.new_objects.sigma_log_view > 0.0,
            anywhere=UnmeasuredRanges.of(configuration).anywhere,
            robot=problem.robot,
        )

    def suits(self, detections: Sequence[Any]) -> bool:
        return all(isinstance(detection, SpatialDetection) for detection in detections)

    def reaching(self, step: Step) -> Self:
        """The places of an open world, whose region may be the image of the step's camera."""
        region = self.region.reaching(step.camera)
        return replace(self, region=region, volume_m3=region.volume_m3, solid_angle=region.solid_angle)

    def log_density(self, step: Step, used: Sequence[int]) -> float:
        detections = [step.detections[i] for i in used]
        ranges = np.array([max(own.range_m, LEAST_DISTANCE_M) for own in detections if own.has_range])
        rays = len(detections) - len(ranges)
        places = 2.0 * float(np.log(ranges).sum()) - len(ranges) * float(np.log(self.volume_m3))
        return places - rays * float(np.log(self.solid_angle)) + self._of_sizes(step, used)

    def log_density_of_first(self, detection: SpatialDetection) -> float:
        prior = self.model.object_prior(detection, self.robot.mean)
        away = prior.mean[:3] - self.spaces.robot.displacement(self.robot.mean, detection.origin, np.zeros(3))
        across = prior.covariance[-1, -1] / float(away @ away)
        if not detection.has_range:
            return -0.5 * float(np.linalg.slogdet(2.0 * np.pi * (across * np.eye(2) + detection.covariance[1:, 1:]))[1])
        spread = np.diag([prior.covariance[-1, -1], across, across]) + detection.covariance
        return -0.5 * float(np.linalg.slogdet(2.0 * np.pi * spread)[1])

    def visible(self, belief: HybridBelief) -> Flags:
        objects = belief.object_poses[:, : self.spaces.landmark.storage_size]
        robots = np.repeat(belief.poses[:1], len(objects), axis=0)
        return np.asarray(self.model.log_visibility(robots, objects, soft=False) == 0.0)

    def expected_births(self, rates: DetectionRates) -> Array:
        return first_detections_in_space(self.region, rates)

    def log_motion(self, step: Step) -> float:
        """Log density of the measurement of gravity, as a robot that dead reckons with gravity predicts it."""
        space, motion = self.spaces.robot, step.motion
        transition = space.propagation(motion.control)
        mean = space.compose(self.robot.mean, motion.control)
        covariance, log_density = transition @ self.robot.covariance @ transition.T + motion.covariance, 0.0
        if motion.gravity is not None:
            level = motion.gravity.levels(mean, covariance)
            mean, covariance, log_density = space.retract(mean, level.shift), level.covariance, level.log_evidence
        self.robot = GaussianPrior(mean, covariance)
        return log_density

    def _of_sizes(self, step: Step, used: Sequence[int]) -> float:
        """Log density of the apparent sizes of boxes, of things of any size; 0 where they are no evidence."""
        if not self.has_sizes or step.words is None or step.words.log_angles is None:
            return 0.0
        total = 0.0
        for number in used:
            detection, log_angle = step.detections[number], float(step.words.log_angles[number])
            if not np.isfinite(log_angle):
                continue
            away, variance = self.anywhere.mean, self.anywhere.sigma**2
            if detection.has_range:
                away, variance = float(np.log(max(detection.range_m, LEAST_DISTANCE_M))), 0.0
            total += float(log_density_of_any(log_angle + away, variance))
        return total
