"""What a value of ``observation`` builds: the space of robot and objects, and what detections tell of them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from semantic_slam.configuration import Configuration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.inference.world.problem import KeyframeReader
from semantic_slam.viewpoint.model import ViewpointModel
from semantic_slam.viewpoint.outliers import OutlierScores

PriorReader = Callable[[Array, Array], GaussianPrior]
"""From a (7,) pose in map and its (6, 6) covariance along the axes of map to a prior of the estimated state."""
JointReader = Callable[[Array, Array], Array]
"""From (n, 7) poses in map and the (3 n, 3 n) joint covariance of x, y, yaw along its axes to that of their states."""


@dataclass(frozen=True, kw_only=True)
class SensingSettings:
    """What a builder is told of the run."""

    configuration: Configuration
    tracks_objects: bool  # objects come and go, or are tracked as if they did
    class_model: ViewpointModel | None  # whose views enter the graphs by factors; None: detections are places alone
    tempering: float  # so many views tell as much as one
    outliers: OutlierScores | None = None  # scores that no class explains; None: there are none
    num_features: int  # F of every detection's feature, 0 where nothing looks at it
    feature_names: tuple[str, ...]  # (F,) or () where the models do not name their features
    labels: tuple[str, ...] = ()  # (L,) of the detector, where they are evidence of classes
    vector_dimensions: int = 0  # of the vectors of appearance that are evidence; 0: they are none


@dataclass(frozen=True, kw_only=True)
class Sensing:
    """The spaces of robot and landmarks and the observation model over them, which go together."""

    spaces: Spaces
    model: ObservationModel
    reader: KeyframeReader
    robot_prior: PriorReader
    object_prior: PriorReader
    joint_prior: JointReader


class SensingBuilder(Protocol):
    """An entry of the registry ``OBSERVATIONS``."""

    def __call__(self, settings: SensingSettings) -> Sensing:
        """For one run. Raises InputError."""
