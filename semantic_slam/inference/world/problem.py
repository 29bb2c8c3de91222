"""What a run is about: models, priors and settings, built once from the run's configuration."""

from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from semantic_slam.configuration import (
    ClosedWorldConfiguration,
    DetectionErrorsConfiguration,
    OpenWorldConfiguration,
    PruningConfiguration,
    RevisionConfiguration,
    WeightsConfiguration,
)
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.models.clutter import Clutter
from semantic_slam.inference.models.latent_observation import LatentObservation
from semantic_slam.inference.models.miss_runs import MissRuns
from semantic_slam.inference.models.moving import Moving
from semantic_slam.inference.models.noise_settings import NoiseSettings
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.semantics.interface import NoSemantics, Semantics
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.smoother import Smoother
from semantic_slam.inference.smoothing.tracking import tracked_before
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.movers import Movers
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.inference.world.inferred_noise import InferredNoise
from semantic_slam.inference.world.objects import ObjectEntry


class KeyframeReader(Protocol):
    """Turns keyframes into steps: the only place that knows the keyframe's content."""

    def step(self, keyframe: Keyframe) -> Step:
        """The step of a keyframe."""


@dataclass(frozen=True, kw_only=True)
class Problem:
    """Everything a backend needs besides keyframes and commits."""

    spaces: Spaces
    model: ObservationModel
    reader: KeyframeReader
    robot: GaussianPrior
    objects: tuple[ObjectEntry, ...]
    class_names: tuple[str, ...]
    seed: int
    association: type[Any]  # an AssociationStrategy as inference/association/strategy.py describes it
    distinct: bool
    semantics: Semantics = field(default_factory=NoSemantics)  # evidence of views, and records of them
    latent: LatentObservation | None = None  # the learned likelihood, where views enter with descriptors
    weights: WeightsConfiguration = field(default_factory=WeightsConfiguration)
    pruning: PruningConfiguration = field(default_factory=PruningConfiguration)
    open_world: OpenWorldConfiguration = field(default_factory=OpenWorldConfiguration)
    detection_errors: DetectionErrorsConfiguration = field(default_factory=DetectionErrorsConfiguration)
    revision: RevisionConfiguration = field(default_factory=RevisionConfiguration)
    moving: Moving = field(default_factory=Moving)
    clutter: Clutter | None = None  # what detections of no object look like; None: a closed world has none
    closed_world: ClosedWorldConfiguration = field(default_factory=ClosedWorldConfiguration)
    unmapped_ids: frozenset[int] = frozenset()  # among ``objects``, of those that the map may lack
    inferred_noise: InferredNoise = field(default_factory=InferredNoise)
    noises: tuple[NoiseSettings | None, ...] = (None,)  # in an open world one for each hypothesis; None: as told

    @property
    def num_biases(self) -> int:
        """Biases of odometry that are estimated with the poses."""
        return len(self.inferred_noise.bias_sigmas)

    @property
    def log_root_weights(self) -> list[float]:
        """Log weights of the hypotheses before any measurement: one for each noise that robot and sensor may have."""
        count = len(self.noises)
        return [-float(np.log(count))] * count

    def root(self) -> Component:
        """The component before any keyframe."""
        priors = {entry.object_id: entry.prior for entry in self.objects}
        existence = {entry.object_id: entry.existence for entry in self.objects}
        return Component.root(self.spaces, self.model, self.robot, priors, self.latent, existence)

    def _single_steps(self, smoother: Smoother) -> Smoother:
        """One that is updated once per keyframe."""
        return smoother.with_single_steps(self.num_biases, errors_repeat=self.detection_errors.correlated_share > 0.0)

    def tracking_root(self, number: int) -> Component:
        """One that tracks its states, under one of the noises, as the configuration wants it updated."""
        plain, single_steps = self.root(), not self.open_world.iterate_updates
        entries = sorted(self.objects, key=lambda entry: entry.object_id)
        tracked = tracked_before(self.spaces, self.robot, [entry.prior for entry in entries], self.num_biases)
        objects, sensor = plain.objects, self.open_world
        if sensor.miss_persistence > 0.0:
            noise = self.noises[number]
            probability = sensor.detection_probability if noise is None else noise.detection_probability
            share = MissRuns(probability, sensor.miss_persistence).share
            objects = replace(objects, detectable=np.full(len(objects.ids), share))
        return replace(
            plain,
            objects=objects,
            smoother=self._single_steps(plain.smoother) if single_steps else plain.smoother,
            tracked=tracked,
            single_steps=single_steps,
            noise=number,
            settings=self.noises[number],
            movers=Movers.none(len(self.moving.speeds), sensor.miss_persistence > 0.0) if self.moving.is_on else None,
        )
