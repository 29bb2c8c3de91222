"""What one keyframe adds to a hypothesis's component."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.evidence.window import Window
from semantic_slam.inference.models.correlated_errors import ErrorTransition
from semantic_slam.inference.models.step import AssociatedDetection
from semantic_slam.inference.smoothing.local_map import LocalMap
from semantic_slam.inference.states.correction import Correction
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.movers import Movers
from semantic_slam.inference.states.object_views import ObjectViews
from semantic_slam.inference.states.outlier_counts import OutlierCounts
from semantic_slam.inference.states.propagated_errors import PropagatedErrors
from semantic_slam.inference.states.tracked_objects import ExistenceUpdate


@dataclass(frozen=True, kw_only=True)
class ComponentUpdate:
    """One continuation of a component, with the modes at which its factors are linearised; states have s numbers."""

    observed: Sequence[AssociatedDetection]  # of objects that stand still
    objects: Sequence[Array]  # (s,) mode of the object of each entry of ``observed``
    robot: Array  # (s,) mode
    predicted: Array  # (s,) predicted robot state, by odometry alone
    new_objects: dict[int, GaussianPrior]
    existence: ExistenceUpdate
    views: dict[int, ObjectViews] = field(default_factory=dict)  # new records of the objects seen
    robot_correction: Correction | None = None
    window: Window | None = None  # since the component was last Gaussian; None: it is
    smoothed: dict[int, Array] = field(default_factory=dict)  # GTSAM key -> (s,) mode, if the window was searched
    corrections: dict[int, Correction] = field(default_factory=dict)  # GTSAM key -> moment correction there
    local: LocalMap | None = None  # updated by the detections, where updates are not iterated
    errors: ErrorTransition | None = None  # of correlated errors to this frame's detections
    movers: Movers | None = None  # afterwards; None: nothing moves
    propagated_errors: PropagatedErrors | None = None  # correlated errors after the motion, if nothing is detected

    outliers: OutlierCounts | None = None  # afterwards; None: as before

    @property
    def assigned_classes(self) -> dict[int, int]:
        """Object id -> class enumerated for it in this keyframe."""
        return {item.object_id: item.assigned_class for item in self.observed if item.assigned_class >= 0}

    @property
    def object_ids(self) -> list[int]:
        """Ids of the objects observed."""
        return [item.object_id for item in self.observed]
