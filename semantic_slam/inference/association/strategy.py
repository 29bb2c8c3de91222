"""Interface of a data association strategy, which the expander calls at every keyframe.

A strategy is one class in one file with one entry in the registry. It predicts a keyframe for some parents; the
:class:`PredictedKeyframe` that it returns enumerates the associations of the detections, weighs them, and states the
effect of each on the objects.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.evidence.weighed_associations import WeighedAssociations
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
    """The P parent hypotheses that a keyframe expands, with their components and weights."""

    ids: Sequence[int]
    components: Sequence[Component]
    log_weights: Array  # (P,)

    @classmethod
    def of(cls, ids: Sequence[int], held: Sequence[WeightedComponent]) -> "Parents":
        """The parents, from weighted components as a backend holds them."""
        weights = np.array([each.log_weight for each in held])
        return cls(ids=ids, components=[each.component for each in held], log_weights=weights)

    def extended(self, places: Sequence[int], variants: Sequence[Component]) -> "Parents":
        """Append ``variants`` of the parents at ``places``: other components with the same ids and weights."""
        return Parents(
            ids=[*self.ids, *(self.ids[place] for place in places)],
            components=[*self.components, *variants],
            log_weights=np.append(self.log_weights, self.log_weights[list(places)]),
        )

    def log_sums(self, log_values: Array, ids: Sequence[int]) -> Array:
        """(n,) log-sum-exp of (P,) values over the parents with each of ``ids``, of which several may share an id."""
        own = np.array(self.ids, dtype=np.uint64)
        return np.array([np.logaddexp.reduce(log_values[own == np.uint64(number)]) for number in ids])

    def __len__(self) -> int:
        return len(self.ids)


class PredictedKeyframe(Protocol):
    """The predicted belief b^-[x_k, O] of every parent (Eqs. 4.11, 4.21), with the keyframe's detections."""

    @property
    def used(self) -> Index:
        """(n,) indices of the detections that are associated; the others are clutter in every candidate."""

    @property
    def expected_births(self) -> Array:
        """(P,) expected number of births: first detections of objects that a parent does not have yet."""

    def associate(self) -> WeighedAssociations:
        """Enumerate the associations of the detections to objects, within the gates."""

    def weigh(self, candidates: WeighedAssociations) -> WeighedAssociations:
        """Add classes where these are enumerated, the evidence (Eq. 4.18) and the states at the modes."""

    def semantic_input(self, candidates: WeighedAssociations) -> SemanticInput:
        """The input of the semantics for these candidates."""

    def existence(self, candidates: WeighedAssociations) -> tuple[Array, Sequence[ExistenceUpdate]]:
        """(K,) log factors of births, detections and misses, and K updates of the objects' existence."""

    def updates(
        self, candidates: WeighedAssociations, rows: Sequence[int], existence: Sequence[ExistenceUpdate]
    ) -> list[ComponentUpdate]:
        """The component updates of some candidates (``rows``), without the records of the semantics."""


class AssociationStrategy(Protocol):
    """A method of data association, configured by its flags."""

    registry: ObjectRegistry  # of the objects of the run
    needs_map: ClassVar[bool]  # a run without a map prior is refused
    wants_identities: ClassVar[bool]  # detections carry the identity of their object
    counts_misses: ClassVar[bool]  # missed detections are evidence
    tracks_objects: ClassVar[bool]  # open world: births and removals; noise settings and biases may be inferred
    defers_view_factors: ClassVar[
        bool
    ]  # views enter a graph only once objects' headings, which no map states, are known
    merges_copies: ClassVar[bool]  # near-duplicate hypotheses arise, and are merged

    def __init__(self, problem: Problem, registry: ObjectRegistry) -> None:
        """The strategy of one run; ``registry`` holds its objects."""

    @classmethod
    def suited_to(cls, configuration: Configuration) -> type[Any]:
        """The AssociationStrategy class to use under the other parameters: a variant of it, or the class itself."""

    @staticmethod
    def check(configuration: Configuration) -> None:
        """Raise InputError if other parameters are incompatible with this strategy."""

    @staticmethod
    def introduce(registry: ObjectRegistry, step: Step) -> None:
        """Register the objects that a keyframe's detections may introduce, identically in every process."""

    @staticmethod
    def reported(registry: ObjectRegistry, alive: Collection[int]) -> ReportedObjects:
        """The objects to report, given the ids ``alive`` that some hypothesis holds."""

    def root(self, root_number: int) -> Component:
        """The root component of a ``root_number`` (its noise setting and start), before any keyframe."""

    def predict(self, step: Step, parents: Parents, path: LineageStep | None) -> PredictedKeyframe:
        """Predict the keyframe for the parents. Raises LostComponentError.

        ``path``: the one continuation of one parent that is wanted, when a lineage is replayed; None: all.
        """


def strategy_of(configuration: Configuration) -> type[AssociationStrategy]:
    """The association strategy of a configuration. Raises InputError for an unknown name."""
    named: type[AssociationStrategy] = ASSOCIATIONS.load(configuration.association)
    return named.suited_to(configuration)
