"""Interface of semantics as a strategy: input are the candidates at their modes, output their evidence and records."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol, Self, runtime_checkable

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.evidence.keyframe_problem import KeyframeProblem
from semantic_slam.inference.evidence.laplace import Mode
from semantic_slam.inference.evidence.weighed_associations import WeighedAssociations
from semantic_slam.inference.models.latent.observation import LatentObservation
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.correction import Correction
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.lineage import Reassigned
from semantic_slam.inference.states.object_views import ObjectViews
from semantic_slam.viewpoint.embeddings.model import EmbeddingModel, EmbeddingRecord
from semantic_slam.viewpoint.labels.model import LabelModel
from semantic_slam.viewpoint.model import ViewpointModel
from semantic_slam.viewpoint.outliers import OutlierScores

Records = Callable[[Sequence[int]], list[dict[int, ObjectViews]]]
"""For some candidates: object id -> record of its views, for the objects of this keyframe, or of all that have one."""

LogPriorOf = Callable[[Sequence[int]], Array]
"""(n, C) log prior of the classes of n objects, by their ids."""


def at_hand(views: list[dict[int, ObjectViews]]) -> Records:
    """Records that were computed together with the weights of K candidates."""
    return lambda rows: [views[row] for row in rows]


@dataclass(frozen=True, kw_only=True)
class SemanticInput:
    """K candidates of some parents at their modes."""

    step: Step
    parents: Sequence[Component]  # P
    candidates: WeighedAssociations
    used: Index  # (n,) detections used
    log_class_prior: Array  # (O, C) of ``candidates.object_ids``
    new: Sequence[dict[int, GaussianPrior]]  # P: objects that this keyframe introduces

    @property
    def stack(self) -> KeyframeProblem:
        """The solved least-squares problems of the candidates."""
        return self.candidates.solved()[0]

    @property
    def mode(self) -> Mode:
        """The modes of those problems."""
        return self.candidates.solved()[1]

    @cached_property
    def object_ids(self) -> list[int]:
        """Ids of the O objects that associations refer to."""
        ids: list[int] = self.candidates.object_ids.tolist()
        return ids

    def take(self, rows: Index) -> "SemanticInput":
        """Semantic input of the chosen candidates."""
        return replace(self, candidates=self.candidates.take(rows))


@dataclass(frozen=True, kw_only=True)
class SemanticEvidence:
    """Semantic evidence of K candidates.

    Records may be computed on demand from the input; that must happen before parents are consumed.
    """

    log_weights: Array  # (K,) evidence beyond that of the factors
    effective_sample_sizes: Array  # (K,) NaN where nothing was sampled
    records: Records  # of the candidates that are grown
    robot: list[Correction | None]  # K

    @classmethod
    def of(cls, log_weights: Array, views: list[dict[int, ObjectViews]]) -> "SemanticEvidence":
        """Evidence without samples and corrections of the robot, with precomputed records."""
        count = len(log_weights)
        return cls(
            log_weights=log_weights,
            effective_sample_sizes=np.full(count, np.nan),
            records=at_hand(views),
            robot=[None] * count,
        )

    @classmethod
    def silent(cls, count: int, records: Records | None = None) -> "SemanticEvidence":
        """No evidence beyond the factors, with ``records`` if any."""
        found = cls.of(np.zeros(count), [{}] * count)
        return found if records is None else replace(found, records=records)


@dataclass(frozen=True, kw_only=True)
class ClassModels:
    """The models that the configured kind of semantics has loaded."""

    configuration: Configuration
    viewpoint: ViewpointModel | None  # P(z | c, viewpoint)
    latent: LatentObservation | None  # P(f | viewpoint, e)
    tempering: float  # number of views that count as one
    labels: LabelModel | None = None  # P(words of a detector | class)
    outliers: OutlierScores | None = None  # outlier distribution of scores; None: no outliers, or no such models
    embeddings: EmbeddingModel | None = None  # P(vectors of appearance | one object)
    appearances: Mapping[int, EmbeddingRecord] = field(default_factory=dict)  # object id -> appearance stored in a map


class Semantics(Protocol):
    """Weighs and records the views of a keyframe."""

    @classmethod
    def of(cls, models: ClassModels) -> Self:
        """The semantics of a run, from a registry entry."""

    def weigh(self, given: SemanticInput) -> SemanticEvidence:
        """Evidence and records; a pure function of the candidates."""


@runtime_checkable
class RanksPairs(Protocol):
    """Semantics with evidence for single pairs: a detection and an object, before joint assignment, or two objects."""

    def log_pairs(
        self,
        step: Step,
        views: Mapping[int, ObjectViews],
        object_ids: Sequence[int],
        log_prior: Array,
        log_ranges: Array,
        variances: Array,
    ) -> Array:
        """(D, M + 1) log evidence of D detections as one of each object with its record so far, and as a new one.

        ``views`` of all objects of a hypothesis, of which M are asked for; ``log_prior`` (M + 1, C) of their classes;
        ``log_ranges`` (D, M) of the M objects and their ``variances`` as seen from each detection's camera.
        """

    def log_of_one(self, own: ObjectViews, other: ObjectViews, log_prior: Array) -> float:
        """Log evidence of the records of two objects as of one, relative to that as of two.

        ``log_prior`` (C,) of either class. Views count as independent given class and size.
        """


def reassociates(configuration: Configuration) -> bool:
    """Whether the views of a run may be reassigned long after they were taken, which only drives with drift need."""
    has_drift = configuration.detection_errors.correlated_share > 0.0
    return configuration.revision.reassociate_every_keyframes > 0 and has_drift


@runtime_checkable
class RetellsViews(Protocol):
    """Semantics whose views can be reassigned to other objects long after they were taken."""

    retells: bool  # whether its configuration allows it

    def retold(
        self, views: Mapping[int, ObjectViews], changes: Sequence[Reassigned], log_prior_of: LogPriorOf
    ) -> tuple[float, dict[int, ObjectViews]]:
        """Log evidence ratio of all views with ``changes`` to those without, and the records with them."""


class NoSemantics:
    """Semantics of a run without class models."""

    @classmethod
    def of(cls, models: ClassModels) -> Self:
        """No models are needed."""
        return cls()

    def weigh(self, given: SemanticInput) -> SemanticEvidence:
        """No evidence, for every candidate."""
        return SemanticEvidence.silent(len(given.candidates.assignments))
