"""Marginals of the hybrid belief over the weighted hypotheses (Eqs. 4.6-4.8)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.candidate_table import CandidateTable
from semantic_slam.inference.entropy import association_entropy, component_entropy
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.object_places import distinct_places
from semantic_slam.inference.object_table import ObjectTable, marginals
from semantic_slam.inference.pruning import Pruned
from semantic_slam.inference.states.lineage import Lineage
from semantic_slam.inference.world.objects import ReportedObjects
from semantic_slam.inference.world.problem import Problem


@dataclass(frozen=True, kw_only=True)
class Mixture:
    """The mixture: H hypotheses with their weights and the marginals of their components; O objects."""

    ids: list[int]
    parent_ids: list[int]
    log_weights: Array  # (H,) normalised
    changes: list[tuple[int, int, int, int]]  # R x (hypothesis id, keyframe, detection, object) of revised histories
    lineages: list[Lineage]
    poses: Array  # (H, 7) robot in map
    pose_covariances: Array  # (H, 6, 6)
    objects: ObjectTable  # (H, O, ...)
    noise: Array  # (H, N, 2) means and standard deviations

    def association_histories(self) -> list[tuple[tuple[int, ...], ...]]:
        """Association history beta of every hypothesis since their last common step; before it all are equal."""
        newest = len(self.lineages[0])
        while newest > 0 and any(lineage[newest - 1] is not self.lineages[0][newest - 1] for lineage in self.lineages):
            newest -= 1
        return [tuple(step.association for step in lineage[newest:]) for lineage in self.lineages]

    def associations(self) -> NDArray[np.int64]:
        """(H, D) object ids of the newest keyframe's detections, -1 clutter."""
        return np.array([lineage[-1].association for lineage in self.lineages], dtype=np.int64)


@dataclass(frozen=True, kw_only=True)
class PassedOver:
    """R candidates of a keyframe with D detections that were weighed and then pruned."""

    weights: Array  # (R,) relative to the total weight of the survivors
    associations: NDArray[np.int64]  # (R, D) object ids, -1 clutter

    @classmethod
    def of(cls, candidates: CandidateTable, kept: Pruned) -> "PassedOver":
        """The candidates that pruning left out."""
        rows = np.delete(np.arange(len(candidates.ids)), kept.kept)
        weights = np.exp(candidates.log_weights[rows] - kept.log_mass)
        return cls(weights=weights, associations=candidates.associations[rows].astype(np.int64))


def _revisions(changes: list[tuple[int, int, int, int]]) -> dict[str, Any]:
    """The belief's fields ``revised_*``: where histories were revised after the fact."""
    kinds = {"ids": np.uint64, "keyframes": np.uint32, "detections": np.uint32, "objects": np.int32}
    columns = zip(*changes, strict=True) if changes else ((),) * len(kinds)
    return {
        f"revised_{name}": np.array(own, dtype=kind) for (name, kind), own in zip(kinds.items(), columns, strict=True)
    }


def association_probabilities(weights: Array, columns: NDArray[np.int32], num_objects: int) -> Array:
    """(D, O + 1) probability that each detection is of each object, from (H,) weights and (H, D) ``columns``.

    The last column is that of -1: clutter or a new object.
    """
    num_detections = columns.shape[1]
    probabilities = np.zeros((num_detections, num_objects + 1))
    np.add.at(probabilities, (np.arange(num_detections), columns), weights[:, None])
    return probabilities


def _probabilities_of_known(
    weights: Array,
    object_ids: NDArray[np.int64],
    reported: ReportedObjects,
    first_new_id: int | None,
    passed_over: PassedOver,
) -> Array:
    """:func:`association_probabilities` of the objects known before the keyframe, from (H, D) ``object_ids``."""

    def columns(ids: NDArray[np.int64]) -> NDArray[np.int32]:
        rows = reported.rows(ids)
        return rows if first_new_id is None else np.where(ids < first_new_id, rows, -1)

    count = len(reported.ids)
    probabilities = association_probabilities(weights, columns(object_ids), count)
    if first_new_id is not None:
        probabilities += association_probabilities(passed_over.weights, columns(passed_over.associations), count)
        probabilities /= 1.0 + passed_over.weights.sum()
    return probabilities


def state_belief(
    step: Step,
    mixture: Mixture,
    reported: ReportedObjects,
    problem: Problem,
    candidates: CandidateTable,
    kept: Pruned,
    *,
    discarded_mass: float,
    first_new_id: int | None,
) -> HybridBelief:
    """The belief after one keyframe, from the mixture over its hypotheses.

    Objects with ids from ``first_new_id`` on were born from this keyframe's detections; None: there are no births.
    Those of the ``candidates`` that were not ``kept`` count only in ``association_probabilities``.
    """
    weights = np.exp(mixture.log_weights)
    object_ids = mixture.associations()
    clutter = np.full(len(step.names), np.nan)  # in an open world it may be a new object
    if first_new_id is None:
        clutter = weights @ (object_ids < 0)
    passed_over = PassedOver.of(candidates, kept)
    state_space = problem.spaces.name
    return HybridBelief(
        stamp_ns=step.stamp_ns,
        keyframe=step.index,
        planar=state_space == "planar",
        class_names=problem.class_names,
        num_candidates=len(candidates.ids),
        hypothesis_ids=np.array(mixture.ids, dtype=np.uint64),
        parent_ids=np.array(mixture.parent_ids, dtype=np.uint64),
        modes=np.array([lineage[-1].mode for lineage in mixture.lineages], dtype=np.uint16),
        log_weights=mixture.log_weights,
        poses=mixture.poses,
        pose_covariances=mixture.pose_covariances,
        detection_ids=step.detection_ids,
        associations=reported.rows(object_ids),
        object_ids=np.array(reported.ids, dtype=np.uint32),
        object_names=tuple(reported.names),
        hypothesis_class_probabilities=mixture.objects.class_probabilities,
        association_entropy=association_entropy(weights, mixture.association_histories()),
        component_entropy=component_entropy(weights),
        discarded_mass=discarded_mass,
        dropped=step.dropped,
        association_probabilities=_probabilities_of_known(weights, object_ids, reported, first_new_id, passed_over),
        outlier_probability=clutter,
        state_space=state_space,
        **_revisions(mixture.changes),
        **distinct_places(weights, mixture.objects),
        **problem.inferred_noise.marginals(weights, mixture.noise, step.sensed),
        **marginals(weights, mixture.objects),
    )
