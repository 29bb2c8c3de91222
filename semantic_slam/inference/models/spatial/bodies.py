"""Range, ray and viewpoint-dependent semantics of an object in space that has a position and an attitude.

Range and ray are those of its centre, as of a point. Gravity fixes its roll and pitch; views determine its yaw.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np

from semantic_slam.geometry import so3
from semantic_slam.geometry.arrays import Array, squared_norms
from semantic_slam.inference.models.observation import Classes
from semantic_slam.inference.models.scored_views import ScoredViews
from semantic_slam.inference.models.spatial.detection import SpatialDetection, SpatialDetections
from semantic_slam.inference.models.spatial.observation import SpatialObservation
from semantic_slam.inference.models.spatial.range_prior import BodyRangePrior, RangePrior
from semantic_slam.inference.models.spatial.ray_factor import ray_factor
from semantic_slam.inference.models.spatial.scored_detection import ScoredDetections
from semantic_slam.inference.models.spatial.views import POSES_IN_SPACE
from semantic_slam.inference.models.view_scores import ViewScores
from semantic_slam.inference.states.gaussian import GaussianPrior


@dataclass(frozen=True)
class BodyObservation(ScoredViews, SpatialObservation):
    """Geometric likelihood of range and ray times the class model of Eq. 4.2 (``scores`` None: geometry alone)."""

    scores: ViewScores | None = None

    spaces = POSES_IN_SPACE

    def _collected(self, detections: Sequence[SpatialDetection]) -> ScoredDetections:
        found = ScoredDetections.of(detections)
        return found if self.scores is None else self.scores.with_outliers(found)

    def log_likelihood(self, detections: Any, x: Array, o: Array, classes: Classes | None) -> Array:
        """(B,) log density without its Jacobians."""
        total = super().log_likelihood(detections, x, o, None)
        return total if classes is None else self._view_scores.added_to(total, detections, x, o, classes)

    def turned_start(self, detections: SpatialDetections, x: Array, first: Array, second: Array) -> Array:
        """Keep roll and pitch, take the yaw that fits the direction from one object to the other."""
        position = self.spaces.landmark.position
        return super().turned_start(detections, x, position(first), position(second))

    def object_priors(self, detections: Sequence[SpatialDetection], x: Array) -> list[GaussianPrior]:
        """Priors of new objects with attitude: position as for points, upright, yaw equal to the robot's."""
        new, attitude = self.new_objects, _upright(x[3:])
        turns = [new.sigma_tilt_rad, new.sigma_tilt_rad, new.sigma_heading_rad]
        at_range = np.diag([*turns, *[new.sigma_position_m] * 3]) ** 2
        return [
            BodyRangePrior.of_body(place, attitude, np.diag(turns) ** 2)
            if isinstance(place, RangePrior)
            else GaussianPrior(np.concatenate([place.mean, attitude]), at_range)
            for place in super().object_priors(detections, x)
        ]

    def geometry_factor(self, detection: SpatialDetection, keys: tuple[int, int]) -> Any:
        """GTSAM's own factor where a range was measured and the ray's error is isotropic, as with points.

        Otherwise a custom factor.
        """
        if not detection.has_range:
            return ray_factor(detection, keys, self.ray_tail, has_attitude=True)
        if detection.is_round:
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
