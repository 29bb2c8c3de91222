"""What a run is about: models, priors and settings, built once from the run's configuration."""

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from semantic_slam.configuration import OpenWorldConfiguration, PruningConfiguration, WeightsConfiguration
from semantic_slam.inference.models.latent_observation import LatentObservation
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.objects import ObjectEntry
from semantic_slam.inference.semantics.interface import CarriedSemantics, Semantics
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.spaces import Spaces


class KeyframeReader(Protocol):
    """Turns keyframes into steps: the only place that knows the keyframe's content."""

    def step(self, keyframe: Any) -> Step:
        """The step of a keyframe."""


@dataclass(frozen=True)
class Problem:
    """Everything a backend needs besides keyframes and commits."""

    spaces: Spaces
    model: ObservationModel
    reader: KeyframeReader
    robot: GaussianPrior
    objects: tuple[ObjectEntry, ...]
    class_names: tuple[str, ...]
    seed: int
    association: str  # enumerated | given | open
    distinct: bool
    semantics: Semantics | None = None  # records of the objects' views; None without class models, or where carried
    carried: CarriedSemantics | None = None  # open world: views that enter no graph before their heading is known
    latent: LatentObservation | None = None  # the learned likelihood, where views enter with descriptors
    weights: WeightsConfiguration = field(default_factory=WeightsConfiguration)
    pruning: PruningConfiguration = field(default_factory=PruningConfiguration)
    open_world: OpenWorldConfiguration = field(default_factory=OpenWorldConfiguration)
    num_biases: int = 0  # of odometry, that are estimated with the poses
    noise_factors: tuple[float, ...] = (1.0,)  # on odometry's covariance, in an open world one for each hypothesis

    @property
    def log_root_weights(self) -> list[float]:
        """Of the hypotheses before any measurement: one for each noise that odometry may have."""
        count = len(self.noise_factors)
        return [-float(np.log(count))] * count

    def root(self) -> Component:
        """The component before any keyframe."""
        priors = {entry.object_id: entry.prior for entry in self.objects}
        return Component.root(self.spaces, self.model, self.robot, priors, self.latent)
