"""The null model's detections in the plane: uniform over the area of the sensor's region."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from semantic_slam.configuration import Configuration, NewObjectConfiguration, VisibilityConfiguration
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array, Flags, broadcast_copy
from semantic_slam.geometry.pose import planar_from_pose_vector
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.open_world.planar.region import SensorRegion, sensor_region
from semantic_slam.inference.open_world.planar.unseen_ground import first_detections
from semantic_slam.inference.states.detection_rates import DetectionRates


@dataclass(frozen=True, kw_only=True)
class PlanarPlaces:
    """Uniform :class:`EvenPlaces` in the plane: a range r has the density r / area, and bearings alone are uniform."""

    region: SensorRegion
    visibility: VisibilityConfiguration
    new_objects: NewObjectConfiguration

    @classmethod
    def of(cls, configuration: Configuration, *, is_open: bool) -> Self:
        """Where an open world expects detections; in a closed one, all that is visible.

        Where a closed world limits no range, the region ends where perception and clutter both end.
        """
        region, limits = sensor_region(configuration.open_world), configuration.visibility
        if not is_open:
            region = SensorRegion(
                min_range_m=0.0,
                max_range_m=limits.max_range_m or max(configuration.perception.max_depth_m, region.max_range_m),
                field_of_view_rad=limits.field_of_view_rad or 2.0 * np.pi,
            )
        return cls(region=region, visibility=limits, new_objects=configuration.new_objects)

    def suits(self, detections: Sequence[Any]) -> bool:
        return all(isinstance(detection, PlanarDetection) for detection in detections)

    def reaching(self, step: Step) -> Self:
        return replace(self, region=self.region.reaching(step.sensed))

    def log_density(self, step: Step, used: Sequence[int]) -> float:
        detections = [step.detections[i] for i in used]
        ranges = [detection.range_m for detection in detections if detection.has_range]
        bearings = len(detections) - len(ranges)
        places = float(np.log(ranges).sum()) - len(ranges) * np.log(self.region.area_m2)
        return float(places) - bearings * float(np.log(self.region.field_of_view_rad))

    def log_density_of_first(self, detection: PlanarDetection) -> float:
        new = self.new_objects
        if not detection.has_range:
            across = min(new.range_m, new.sigma_position_m) / new.range_m
            return -0.5 * float(np.log(2.0 * np.pi * (across**2 + detection.covariance[1, 1])))
        spread = np.diag([1.0, detection.range_m**-2]) * new.sigma_position_m**2 + detection.covariance
        return -0.5 * float(np.linalg.slogdet(2.0 * np.pi * spread)[1])

    def visible(self, belief: HybridBelief) -> Flags:
        if self.visibility.max_range_m <= 0.0 and self.visibility.field_of_view_rad <= 0.0:
            return np.ones(len(belief.object_ids), dtype=bool)
        objects = np.array([planar_from_pose_vector(pose) for pose in belief.object_poses])
        robot = planar_from_pose_vector(belief.poses[0])
        relative = se2.between(broadcast_copy(robot, objects.shape), objects)[:, :2]
        return np.asarray(self.region.contains(relative, np.zeros((len(relative), 2, 2))) >= 0.5)

    def expected_births(self, rates: DetectionRates) -> Array:
        nothing = np.zeros((0, 3)), np.zeros(3), np.zeros((0, 2))
        return first_detections(self.region, rates, *nothing, 1.0)[0]

    def log_motion(self, step: Step) -> float:
        """0: nothing is measured beside odometry."""
        return 0.0
