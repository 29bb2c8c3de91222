"""What one keyframe adds to a hypothesis's component."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.evidence.window import Window
from semantic_slam.inference.models.correlated_errors import ErrorTransition
from semantic_slam.inference.models.step import AssociatedDetection
from semantic_slam.inference.smoothing.local_map import LocalMap
from semantic_slam.inference.states.carried_errors import CarriedErrors
from semantic_slam.inference.states.correction import Correction
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.movers import Movers
from semantic_slam.inference.states.object_views import ObjectViews
from semantic_slam.inference.states.outlier_counts import OutlierCounts
from semantic_slam.inference.states.tracked_objects import ExistenceUpdate


@dataclass(frozen=True, kw_only=True)
class ComponentUpdate:
    """One continuation of a component, with the modes at which its new factors are created; s numbers of a state."""

    observed: Sequence[AssociatedDetection]  # of objects that stand still
    objects: Sequence[Array]  # (s,) mode of the object of each entry of ``observed``
    robot: Array  # (s,) mode
    predicted: Array  # (s,) of the robot, by odometry alone
    new_objects: dict[int, GaussianPrior]
    existence: ExistenceUpdate
    views: dict[int, ObjectViews] = field(default_factory=dict)  # new records of the objects seen
    robot_correction: Correction | None = None
    window: Window | None = None  # since the component was last Gaussian; None: it is
    smoothed: dict[int, Array] = field(default_factory=dict)  # GTSAM key -> (s,) mode, where the window was looked at
    corrections: dict[int, Correction] = field(default_factory=dict)  # GTSAM key -> of the Gaussian at that mode
    local: LocalMap | None = None  # after the detections, where updates are not iterated
    errors: ErrorTransition | None = None  # to those of this frame's detections, where they repeat
    movers: Movers | None = None  # afterwards; None: nothing moves
    carried_errors: CarriedErrors | None = None  # as the motion leaves them, where this frame has no detections

    outliers: OutlierCounts | None = None  # afterwards; None: as before

    @property
    def assigned_classes(self) -> dict[int, int]:
        """Object id -> class that is enumerated for it here."""
        return {item.object_id: item.assigned_class for item in self.observed if item.assigned_class >= 0}

    @property
    def object_ids(self) -> list[int]:
        """Ids of the objects observed."""
        return [item.object_id for item in self.observed]
