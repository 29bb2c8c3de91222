"""Interface of the ``observation`` parameter's builders: state spaces, observation model, reader and priors."""

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
"""Converts a (7,) pose in map and its (6, 6) covariance along the axes of map to a prior of the estimated state."""
JointReader = Callable[[Array, Array], Array]
"""Converts (n, 7) poses in map and their (3 n, 3 n) covariance of x, y, yaw along its axes to that of their states."""


@dataclass(frozen=True, kw_only=True)
class SensingSettings:
    """Input of a builder: the run's configuration, and what follows from its class models."""

    configuration: Configuration
    tracks_objects: bool  # open world (births, misses), or objects are tracked as if it were
    class_model: ViewpointModel | None  # class model whose views are factors of the graphs; None: geometry alone
    tempering: float  # number of views that carry as much information as one independent view
    outliers: OutlierScores | None = None  # density of outlier scores; None: no view is an outlier
    num_features: int  # F components of a detection's feature, 0 where features are not used
    feature_names: tuple[str, ...]  # (F,) or () where the models do not name their features
    labels: tuple[str, ...] = ()  # (L,) of the detector, where they are evidence of classes
    vector_dimensions: int = 0  # of appearance vectors where these are evidence, else 0


@dataclass(frozen=True, kw_only=True)
class Sensing:
    """State spaces of robot and landmarks, with the matching observation model, keyframe reader and priors."""

    spaces: Spaces
    model: ObservationModel
    reader: KeyframeReader
    robot_prior: PriorReader
    object_prior: PriorReader
    joint_prior: JointReader


class SensingBuilder(Protocol):
    """An entry of the registry ``OBSERVATIONS``."""

    def __call__(self, settings: SensingSettings) -> Sensing:
        """Build the sensing of one run. Raises InputError."""
