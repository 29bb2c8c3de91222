"""Data association as a strategy: what the expander asks of it, keyframe by keyframe.

A strategy is one class in one file with one entry in the registry. It predicts a keyframe for some parents; what comes
back enumerates the associations of the detections, weighs them, and says what each makes of the objects.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.evidence.candidates import Candidates
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.semantics.interface import SemanticInput
from semantic_slam.inference.smoothing.component import Component, WeightedComponent
from semantic_slam.inference.smoothing.component_update import ComponentUpdate
from semantic_slam.inference.states.lineage import LineageStep
from semantic_slam.inference.states.tracked_objects import ExistenceUpdate
from semantic_slam.inference.world.objects import ObjectRegistry, ReportedObjects
from semantic_slam.inference.world.problem import Problem
from semantic_slam.registry import ASSOCIATIONS


@dataclass(frozen=True, kw_only=True)
class Parents:
    """P hypotheses that a keyframe expands."""

    ids: Sequence[int]
    components: Sequence[Component]
    log_weights: Array  # (P,)

    @classmethod
    def of(cls, ids: Sequence[int], held: Sequence[WeightedComponent]) -> "Parents":
        """Parents of a keyframe's candidates, from hypotheses as a backend holds them."""
        weights = np.array([each.log_weight for each in held])
        return cls(ids=ids, components=[each.component for each in held], log_weights=weights)

    def log_sums(self, log_values: Array, ids: Sequence[int]) -> Array:
        """(n,) log sums of the exponentials of (P,) values over all parents of each of ``ids``."""
        own = np.array(self.ids, dtype=np.uint64)
        return np.array([np.logaddexp.reduce(log_values[own == np.uint64(number)]) for number in ids])

    def __len__(self) -> int:
        return len(self.ids)


class PredictedKeyframe(Protocol):
    """b^-[x_k, O] of every parent (Eqs. 4.11, 4.21), and what its detections may be."""

    @property
    def used(self) -> Index:
        """(n,) detections that take part; the others are clutter in every candidate."""

    @property
    def expected_births(self) -> Array:
        """(P,) detections that each parent expects of objects that nobody knows yet."""

    def associate(self) -> Candidates:
        """The associations of the detections to objects, as far as the gates admit."""

    def weigh(self, candidates: Candidates) -> Candidates:
        """Candidates with classes where these are enumerated, evidence (Eq. 4.18) and the states at the modes."""

    def semantic_input(self, candidates: Candidates) -> SemanticInput:
        """What the semantics are told of the candidates."""

    def existence(self, candidates: Candidates) -> tuple[Array, Sequence[ExistenceUpdate]]:
        """(K,) log factors of births, detections and misses, and what becomes of the objects' existence."""

    def updates(
        self, candidates: Candidates, rows: Sequence[int], existence: Sequence[ExistenceUpdate]
    ) -> list[ComponentUpdate]:
        """What some candidates add to the components of their parents, without what semantics say."""


class AssociationStrategy(Protocol):
    """One way to tell which detection is of which object."""

    registry: ObjectRegistry  # of the objects that the run has come to know
    needs_map: ClassVar[bool]  # a run without a map prior is refused
    wants_identities: ClassVar[bool]  # detections carry the identity of their object
    counts_misses: ClassVar[bool]  # a frame without detections says something
    tracks_objects: ClassVar[bool]  # objects come and go; odometry may have one of several noises, and biases
    carries_views: ClassVar[bool]  # no map tells how objects are turned: views wait for that before they enter a graph
    merges_copies: ClassVar[bool]  # hypotheses become near copies of each other, and are merged

    def __init__(self, problem: Problem, registry: ObjectRegistry) -> None:
        """For one run; ``registry``: the objects that it has come to know."""

    @classmethod
    def suited_to(cls, configuration: Configuration) -> type[Any]:
        """The AssociationStrategy that works under the other parameters; itself where it has no others beside it."""

    @staticmethod
    def check(configuration: Configuration) -> None:
        """Raises InputError where the other parameters do not go together with it."""

    @staticmethod
    def introduce(registry: ObjectRegistry, step: Step) -> None:
        """Note the objects that the detections of a keyframe bring, which every process does alike."""

    @staticmethod
    def reported(registry: ObjectRegistry, alive: Collection[int]) -> ReportedObjects:
        """The objects that are reported while hypotheses hold those ``alive``."""

    def root(self, number: int) -> Component:
        """The component before any keyframe, under the beginning of that number: a noise of odometry, and a start."""

    def predict(self, step: Step, parents: Parents, path: LineageStep | None) -> PredictedKeyframe:
        """The keyframe as the parents expect it; ``path``: one candidate of one parent. Raises LostComponentError."""


def strategy_of(configuration: Configuration) -> type[AssociationStrategy]:
    """The class that associates in a run of this configuration. Raises InputError for a name that nobody knows."""
    named: type[AssociationStrategy] = ASSOCIATIONS.load(configuration.association)
    return named.suited_to(configuration)
