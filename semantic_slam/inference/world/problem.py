"""The inference problem of a run: models, priors and settings, built once from the run's configuration."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from semantic_slam.configuration import (
    ClosedWorldConfiguration,
    DetectionErrorsConfiguration,
    HistoryConfiguration,
    OpenWorldConfiguration,
    PruningConfiguration,
    RevisionConfiguration,
    WeightsConfiguration,
)
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.evidence.bagging import Bagging
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.models.clutter import Clutter
from semantic_slam.inference.models.latent.observation import LatentObservation
from semantic_slam.inference.models.moving import Moving
from semantic_slam.inference.models.noise.heavy_tail import HeavyTail
from semantic_slam.inference.models.noise.noise_settings import NoiseSettings, errors_under
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.semantics.interface import NoSemantics, Semantics
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.gaussian import GaussianPrior, JointPrior
from semantic_slam.inference.states.lineage import LineageStep
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.inference.world.carried import Carried
from semantic_slam.inference.world.displaced_objects import Displaced
from semantic_slam.inference.world.inferred_noise import InferredNoise
from semantic_slam.inference.world.objects import ObjectEntry
from semantic_slam.inference.world.places_on_map import PlacesOnMap
from semantic_slam.inference.world.slips import Slips
from semantic_slam.inference.world.starts import ANYWHERE, Starts
from semantic_slam.viewpoint.embeddings.model import EmbeddingModel
from semantic_slam.viewpoint.model import ViewpointModel


class KeyframeReader(Protocol):
    """Converts keyframes to steps, the engine's input; the only place that reads a keyframe's content."""

    def step(self, keyframe: Keyframe) -> Step:
        """The step (motion and detections) of a keyframe."""


@dataclass(frozen=True, kw_only=True)
class Problem:
    """Everything that a backend needs besides keyframes and commits."""

    spaces: Spaces
    model: ObservationModel
    reader: KeyframeReader
    robot: GaussianPrior
    objects: tuple[ObjectEntry, ...]
    class_names: tuple[str, ...]
    class_shares: Array  # (C,) class prior of objects that are not mapped
    seed: int
    association: type[Any]  # an AssociationStrategy as inference/association/strategy.py describes it
    distinct: bool  # whether the detections of a keyframe are of different objects
    joint: JointPrior | None = None  # of objects of the map; None: their priors are independent
    semantics: Semantics = field(default_factory=NoSemantics)  # weighs and records views of objects
    viewpoint: ViewpointModel | None = None  # class model that depends on the viewpoint, if views are evidence by it
    latent: LatentObservation | None = None  # learned likelihood, if views are evidence by descriptors
    embeddings: EmbeddingModel | None = None  # model of appearance vectors, if these are evidence
    novelty_false_alarms: float = 0.0  # share of the views of known objects that are not recognised
    weights: WeightsConfiguration = field(default_factory=WeightsConfiguration)
    pruning: PruningConfiguration = field(default_factory=PruningConfiguration)
    open_world: OpenWorldConfiguration = field(default_factory=OpenWorldConfiguration)
    detection_errors: DetectionErrorsConfiguration = field(default_factory=DetectionErrorsConfiguration)
    revision: RevisionConfiguration = field(default_factory=RevisionConfiguration)
    history: HistoryConfiguration = field(default_factory=HistoryConfiguration)
    moving: Moving = field(default_factory=Moving)
    clutter: Clutter | None = None  # density of clutter (false alarms); None: a closed world has none
    closed_world: ClosedWorldConfiguration = field(default_factory=ClosedWorldConfiguration)
    unmapped_ids: frozenset[int] = frozenset()  # those of ``objects`` that stand for objects missing in the map
    displaced: Displaced = field(default_factory=Displaced)  # displaced twins among ``objects``
    inferred_noise: InferredNoise = field(default_factory=InferredNoise)
    sigma_metre: float = 0.0  # relative sigma of the global scale of all ranges, which without a map is unobservable
    noise_settings: tuple[NoiseSettings | None, ...] = (
        None,
    )  # open world: one per root hypothesis; None: as configured
    carried: Carried | None = None  # prior of a kidnapped robot; None: it is never carried
    slips: Slips | None = None  # wheel slip of odometry; None: never
    starts: Starts | None = None  # global localisation in a map, open world: initial poses; None: as its prior

    @cached_property
    def map_ids(self) -> frozenset[int]:
        """Ids of the map's objects."""
        return frozenset(entry.object_id for entry in self.objects)

    @property
    def clutter_rate(self) -> float:
        """False alarms per frame beside a known map; 0 where every detection is of an object."""
        return 0.0 if self.clutter is None else self.closed_world.clutter_per_frame

    @cached_property
    def mapped(self) -> tuple[ObjectEntry, ...]:
        """The objects of the map itself, without placeholders of unmapped ones and displaced twins."""
        apart = self.unmapped_ids | self.displaced.on_map.keys()
        return tuple(entry for entry in self.objects if entry.object_id not in apart)

    @cached_property
    def places_on_map(self) -> PlacesOnMap:
        """Where the map has these objects; there must be some."""
        return PlacesOnMap.of(self.spaces.landmark, self.mapped, self.joint)

    @cached_property
    def open_weights(self) -> WeightsConfiguration:
        """Settings of the weights in an open world, whose associations are limited apart from those on a known map."""
        own, world = self.weights, self.open_world
        most, gate = world.max_candidates or own.max_candidates, world.candidate_gate or own.gate
        return replace(own, max_candidates=most, gate=gate)

    @property
    def bagging(self) -> Bagging:
        """Averaging of weights between the places of the robot, see ``Bagging``."""
        return Bagging(self.seed, self.weights.bagged_sets)

    @property
    def num_biases(self) -> int:
        """Number of odometry biases; those with sigma 0 are not estimated."""
        return len(self.inferred_noise.bias_sigmas)

    @property
    def log_root_weights(self) -> list[float]:
        """Log prior weights of the root hypotheses, normalised: one for each noise setting of robot and sensor."""
        log_priors = np.array([0.0 if settings is None else settings.log_prior for settings in self.noise_settings])
        return [float(log_weight) for log_weight in log_priors - np.log(np.exp(log_priors).sum())]

    def root_number(self, lineage: Sequence[LineageStep]) -> int:
        """Root number of a history: index of its noise setting + number of noise settings x number of its start."""
        return lineage[0].mode if len(self.noise_settings) > 1 or self.starts is not None else 0

    def noise_index_of(self, root_number: int) -> int:
        """The index of the noise setting of a root number."""
        return root_number % len(self.noise_settings)

    def start_of(self, root_number: int) -> int:
        """The start of a root number, see ``Starts``."""
        return root_number // len(self.noise_settings)

    def with_start(self, root_number: int, start: int) -> int:
        """The root number with the same noise setting, and another start."""
        return self.noise_index_of(root_number) + start * len(self.noise_settings)

    def is_placed(self, lineage: Sequence[LineageStep]) -> bool:
        """Whether the robot is localised in the map, in a history."""
        return self.starts is None or self.start_of(self.root_number(lineage)) != ANYWHERE

    def log_weight_of(self, root_number: int) -> float:
        """Log prior weight of a root number."""
        log_weight = self.log_root_weights[self.noise_index_of(root_number)]
        return log_weight if self.starts is None else log_weight + self.starts.log_weight(self.start_of(root_number))

    def tail_of(self, component: Component) -> HeavyTail | None:
        """The outliers that a hypothesis expects among detections; None: none is one."""
        return HeavyTail.of(errors_under(component.noise_settings, self.detection_errors), component.outliers)
