"""Range, ray and viewpoint-dependent semantics of an object in space that has a position and an attitude.

Range and ray are those of its centre, as of a point. Gravity fixes its roll and pitch; views determine its yaw.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import gtsam
import numpy as np

from semantic_slam.geometry import so3
from semantic_slam.geometry.arrays import Array, squared_norms
from semantic_slam.inference.models.observation import Classes
from semantic_slam.inference.models.scored_views import ScoredViews
from semantic_slam.inference.models.spatial.detection import SpatialDetection, SpatialDetections
from semantic_slam.inference.models.spatial.observation import SpatialObservation
from semantic_slam.inference.models.spatial.scored_detection import ScoredDetections
from semantic_slam.inference.models.spatial.views import POSES_IN_SPACE
from semantic_slam.inference.models.view_scores import ViewScores
from semantic_slam.inference.states.gaussian import GaussianPrior


@dataclass(frozen=True)
class BodyObservation(ScoredViews, SpatialObservation):
    """Geometric likelihood of range and ray times the class model of Eq. 4.2 (``scores`` None: geometry alone)."""

    scores: ViewScores | None = None
    _newest: list[tuple[Sequence[SpatialDetection], ScoredDetections]] = field(default_factory=list)

    spaces = POSES_IN_SPACE

    def collect(self, detections: Sequence[SpatialDetection]) -> ScoredDetections:
        """Detections as arrays; cached, as one hypothesis after the other asks for the same ones."""
        if not self._newest or self._newest[0][0] is not detections:
            found = ScoredDetections.of(detections)
            found = found if self.scores is None else self.scores.with_outliers(found)
            self._newest[:] = [(detections, found)]
        return self._newest[0][1]

    def log_likelihood(self, detections: Any, x: Array, o: Array, classes: Classes | None) -> Array:
        """(B,) log density without its Jacobians."""
        total = super().log_likelihood(detections, x, o, None)
        return total if classes is None else self._view_scores.added_to(total, detections, x, o, classes)

    def turned_start(self, detections: SpatialDetections, x: Array, first: Array, second: Array) -> Array:
        """Keep roll and pitch, take the yaw that fits the direction from one object to the other."""
        position = self.spaces.landmark.position
        return super().turned_start(detections, x, position(first), position(second))

    def object_prior(self, detection: SpatialDetection, x: Array) -> GaussianPrior:
        """Prior at the measured position, upright, heading as the robot's; without a range, as wide as it is far."""
        new = self.new_objects
        distance, sigma_m = detection.range_m, new.sigma_position_m
        if not detection.has_range:
            distance, sigma_m = new.range_m, min(new.range_m, new.sigma_position_m)
        place = self.spaces.robot.displacement(x, detection.origin + distance * detection.ray, np.zeros(3))
        sigmas = [new.sigma_tilt_rad, new.sigma_tilt_rad, new.sigma_heading_rad, *[sigma_m] * 3]
        return GaussianPrior(np.concatenate([place, _upright(x[3:])]), np.diag(sigmas) ** 2)

    def geometry_factor(self, detection: SpatialDetection, keys: tuple[int, int]) -> Any:
        """GTSAM's own factor where a range was measured and the ray's error is isotropic, as with points.

        Otherwise a custom factor.
        """
        if detection.is_round and detection.has_range:
            return gtsam.BearingRangeFactorPose3(*keys, detection.direction, detection.range_m, detection.noise)
        return self._custom_factor(detection, keys)

    def view_change(self, before: Array, now: Array) -> Array:
        """Change of the view's direction or of the attitude [rad], from poses of objects in the robot's frame."""
        moved = np.sqrt(squared_norms(now[:, :3] - before[:, :3])) / self.distance(before[:, :3])
        turn = so3.log(so3.product(so3.inverse(before[:, 3:]), now[:, 3:]))
        return np.maximum(moved, np.sqrt(squared_norms(turn)))


def _upright(attitude: Array) -> Array:
    """(4,) the rotation about the vertical nearest to an attitude (4,); identity where all are equally near."""
    about = np.array([0.0, 0.0, attitude[2], attitude[3]])
    return so3.normalised(about) if about.any() else np.array([0.0, 0.0, 0.0, 1.0])
