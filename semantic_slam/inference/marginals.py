"""Marginals of the hybrid belief: Eqs. 4.6-4.8 from weighted hypotheses."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.moments import matched_moments_of_many
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.entropy import association_entropy, component_entropy
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.states.lineage import LineageStep
from semantic_slam.inference.world.objects import ObjectRegistry


@dataclass(frozen=True)
class Mixture:
    """H hypotheses with their components; O objects."""

    ids: list[int]
    parent_ids: list[int]
    log_weights: Array  # (H,) normalised
    lineages: list[tuple[LineageStep, ...]]
    poses: Array  # (H, 7)
    pose_covariances: Array  # (H, 6, 6)
    object_poses: Array  # (H, O, 7)
    object_covariances: Array  # (H, O, 6, 6)
    class_probabilities: Array  # (H, O, C)
    mutual_information: Array  # (H, O)
    in_coverage: NDArray[np.bool_]  # (H, O)
    forgotten_views: NDArray[np.uint32]  # (H, O)
    existence: Array  # (H, O) NaN where a hypothesis has no such object
    descriptors: Array  # (H, O, L) NaN there, too
    descriptor_variances: Array  # (H, O, L)

    def association_histories(self) -> list[tuple[tuple[int, ...], ...]]:
        """beta of every hypothesis since they were last one; before that they agree."""
        newest = len(self.lineages[0])
        while newest > 0 and any(lineage[newest - 1] is not self.lineages[0][newest - 1] for lineage in self.lineages):
            newest -= 1
        return [tuple(step.association for step in lineage[newest:]) for lineage in self.lineages]

    def associations(self) -> NDArray[np.int64]:
        """(H, D) object ids of the newest keyframe's detections, -1 clutter."""
        return np.array([lineage[-1].association for lineage in self.lineages], dtype=np.int64)


def epistemic_part(weights: Array, by_hypothesis: Array) -> Array:
    """(O,) average of (H, O) mutual information over the hypotheses that have seen the object, NaN where none has."""
    seen = weights[:, None] * np.isfinite(by_hypothesis)
    total = seen.sum(axis=0)
    summed = (seen * np.nan_to_num(by_hypothesis)).sum(axis=0)
    return np.where(total > 0.0, summed / np.where(total > 0.0, total, 1.0), np.nan)


def matched_descriptors(weights: Array, means: Array, variances: Array) -> tuple[Array, Array]:
    """(O, L) means and variances of the mixture of (H,) Gaussians; NaN where a hypothesis has no such object."""
    if not means.shape[-1]:
        return means[0], variances[0]
    share = weights[:, None, None] * np.isfinite(means)
    share /= np.maximum(share.sum(axis=0), 1e-300)
    known, spread = np.nan_to_num(means), np.nan_to_num(variances)
    mean = (share * known).sum(axis=0)
    return mean, np.asarray((share * (spread + (known - mean) ** 2)).sum(axis=0))


def state_belief(
    step: Step,
    mixture: Mixture,
    registry: ObjectRegistry,
    class_names: Sequence[str],
    num_candidates: int,
    discarded_mass: float,
) -> HybridBelief:
    """The belief after one keyframe."""
    weights = np.exp(mixture.log_weights)
    poses, covariances = matched_moments_of_many(weights, mixture.object_poses, mixture.object_covariances)
    descriptors, variances = matched_descriptors(weights, mixture.descriptors, mixture.descriptor_variances)
    return HybridBelief(
        stamp_ns=step.stamp_ns,
        keyframe=step.index,
        planar=True,
        class_names=tuple(class_names),
        num_candidates=num_candidates,
        hypothesis_ids=np.array(mixture.ids, dtype=np.uint64),
        parent_ids=np.array(mixture.parent_ids, dtype=np.uint64),
        modes=np.array([lineage[-1].mode for lineage in mixture.lineages], dtype=np.uint16),
        log_weights=mixture.log_weights,
        poses=mixture.poses,
        pose_covariances=mixture.pose_covariances,
        detection_ids=step.detection_ids,
        associations=registry.indices(mixture.associations()),
        object_ids=np.array(registry.ids, dtype=np.uint32),
        object_names=tuple(registry.names),
        hypothesis_class_probabilities=mixture.class_probabilities,
        existence=np.minimum(weights @ np.nan_to_num(mixture.existence), 1.0),
        class_probabilities=np.einsum("h,hoc->oc", weights, mixture.class_probabilities),
        object_poses=poses,
        object_covariances=covariances,
        mutual_information=epistemic_part(weights, mixture.mutual_information),
        in_coverage=weights @ mixture.in_coverage >= 0.5,
        forgotten_views=mixture.forgotten_views[int(np.argmax(weights))],
        descriptors=descriptors,
        descriptor_covariances=variances,
        association_entropy=association_entropy(weights, mixture.association_histories()),
        component_entropy=component_entropy(weights),
        discarded_mass=discarded_mass,
        dropped=step.dropped,
    )
