"""What a run asks of its semantics besides factors: the record of each object's views, and evidence from tracks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.evidence.keyframe_problem import KeyframeProblem
from semantic_slam.inference.evidence.laplace import Mode
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.correction import Correction
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.object_table import ObjectTable
from semantic_slam.inference.states.object_views import ObjectViews

Records = Callable[[Sequence[int]], list[dict[int, ObjectViews]]]
"""Of some continuations: object id -> record of its views, for the objects of this keyframe."""


def at_hand(views: list[dict[int, ObjectViews]]) -> Records:
    """Of K continuations, made with their weights."""
    return lambda rows: [views[row] for row in rows]


@dataclass(frozen=True)
class SemanticInput:
    """K continuations of some parents at their geometric modes."""

    step: Step
    parents: Sequence[Component]
    stack: KeyframeProblem
    mode: Mode
    used: NDArray[np.int_]  # (n,) detections that take part
    object_ids: Sequence[int]  # O that ``stack.rows.objects`` refers to
    log_class_prior: Array  # (O, C)
    new: Sequence[dict[int, GaussianPrior]]  # for each parent, the objects that this keyframe introduces

    def take(self, rows: NDArray[np.int_]) -> "SemanticInput":
        """Some of the continuations."""
        return replace(self, stack=self.stack.select(rows), mode=self.mode.take(rows))


@dataclass(frozen=True)
class SemanticEvidence:
    """What semantics say of K continuations.

    Records may be made when they are asked for, from the moment; that is before parents are used up.
    """

    log_weights: Array  # (K,) evidence besides that of the factors
    effective_sample_sizes: Array  # (K,) NaN where nothing was sampled
    records: Records  # of those that grow
    robot: list[Correction | None]  # K

    @classmethod
    def silent(cls, count: int, records: Records | None = None) -> "SemanticEvidence":
        """Nothing besides the factors, and ``records`` if any."""
        known = records or at_hand([{}] * count)
        return cls(np.zeros(count), np.full(count, np.nan), known, [None] * count)


@dataclass(frozen=True)
class CarriedInput:
    """K continuations at their modes; D detections."""

    detections: Sequence[Any]  # D
    in_coverage: NDArray[np.bool_]  # (D,)
    components: Sequence[Component]  # P
    populations: Sequence[ObjectTable]  # P
    parents: NDArray[np.int_]  # (K,)
    association: NDArray[np.int_]  # (K, D) object ids
    robot: Array  # (K, 3)
    objects: Array  # (K, D, 3)
    log_class_prior: dict[int, Array]  # object id -> (C,)
    keyframe: int
    robot_covariance: Array  # (K, 3, 3)


class Semantics(Protocol):
    """Records the views of a keyframe."""

    def weigh(self, moment: SemanticInput) -> SemanticEvidence:
        """A pure function of the continuations."""


class CarriedSemantics(Protocol):
    """Carries with each object what its views tell, class or descriptor and heading, instead of factors."""

    def carried(self, views: CarriedInput) -> SemanticEvidence:
        """Log evidence of the views of each continuation, and the objects' records after it."""
