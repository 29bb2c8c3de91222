"""Joint Gaussian of descriptors and geometry of continuations, from their parents' smoothers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.models.latent.detection_features import DetectionFeatures
from semantic_slam.inference.models.latent.observation import LatentObservation
from semantic_slam.inference.semantics.descriptors.descriptor_problem import DescriptorProblem
from semantic_slam.inference.semantics.interface import SemanticInput
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.keys import descriptor_key, object_key, robot_key
from semantic_slam.inference.states.layout import rows_of_blocks

LEAST_SHARE = 1e-4
"""Least share of its variance that a descriptor keeps where rounding would make it negative."""
JITTER = 1e-9
"""Added relative to the prior variances: keeps conditional covariances of descriptors positive definite."""


@dataclass(frozen=True)
class PredictedDescriptors:
    """One parent's descriptors of O objects, joint with the predicted robot and objects; dimensions r, l, L."""

    mean: Array  # (O, L)
    covariance: Array  # (O L, O L)
    cross: Array  # (O L, r + O l) with robot and objects

    @classmethod
    def of(
        cls, component: Component, given: SemanticInput, wanted: Sequence[int], observation: LatentObservation
    ) -> "PredictedDescriptors":
        """Predicted descriptors of the objects of ``given``; those not at the indices ``wanted`` keep their priors."""
        count, length = len(given.object_ids), observation.num_dimensions
        layout = component.spaces.layout
        priors = [observation.prior_of(n) for n in given.object_ids]
        mean = np.array([prior.mean[0] for prior in priors]).reshape(count, length)
        covariance = np.diag(np.array([prior.sigma[0] for prior in priors]).ravel() ** 2)
        cross = np.zeros((count * length, layout.size(count)))
        known = [p for p in wanted if component.smoother.has(descriptor_key(given.object_ids[p]))]
        if known:
            keys = [descriptor_key(given.object_ids[p]) for p in known]
            mean[known] = component.smoother.descriptors(keys)
            poses = [robot_key(component.keyframe), *(object_key(given.object_ids[p]) for p in known)]
            joint = component.joint_covariance([*poses, *keys])
            split, robot = layout.size(len(known)), layout.block(0)
            along = joint[split:, :split].copy()
            along[:, robot] = along[:, robot] @ component.spaces.robot.propagation(given.step.motion.control).T
            rows, columns = rows_of_blocks(known, length), layout.rows([0, *(1 + p for p in known)])
            covariance[rows[:, None], rows] = joint[split:, split:]
            cross[rows[:, None], columns] = along
        return cls(mean, covariance, cross)


def descriptor_problem(
    given: SemanticInput, observation: LatentObservation, rows: Index, active: NDArray[np.bool_]
) -> DescriptorProblem:
    """The least-squares problems of the continuations ``rows``, over their ``active`` (B, n) detections.

    Raises LostComponentError.
    """
    stack = given.stack.select(rows)
    y, hessian = given.mode.y[rows], given.mode.hessian[rows]
    mean, cross, covariance = _gathered(given, observation, rows)
    batch, count, length = mean.shape
    spread = np.linalg.inv(np.swapaxes(np.linalg.cholesky(hessian), 1, 2))  # y = y* + spread u
    by_y = np.swapaxes(np.linalg.solve(stack.root, np.swapaxes(cross, 1, 2)), 1, 2)
    rest = covariance - by_y @ np.swapaxes(by_y, 1, 2)
    own = _root(rest, np.einsum("bii->bi", covariance))
    tangent_offset = (stack.root @ y[..., None])[..., 0]
    descriptor_offset = mean.reshape(batch, -1) + (by_y @ y[..., None])[..., 0]
    size = stack.size
    gain = np.zeros((batch, size + count * length, size + count * length))
    gain[:, :size, :size] = stack.root @ spread
    gain[:, size:, :size] = by_y @ spread
    gain[:, size:, size:] = own
    return DescriptorProblem(
        spaces=stack.spaces,
        observation=observation,
        seen=DetectionFeatures.of([given.step.detections[i] for i in given.used]),
        active=active,
        slots=stack.slots,
        mean=stack.mean,
        offset=np.concatenate([tangent_offset, descriptor_offset], axis=1),
        gain=gain,
    )


def _root(covariance: Array, scale: Array) -> Array:
    """(B, N, N) lower Cholesky factors; ``scale`` (B, N) variances before conditioning.

    Marginals of a map that is uncertain by metres are rounded to more than a descriptor's variance. A negative result
    is raised to a share of the variance before.
    """
    try:
        return np.asarray(np.linalg.cholesky(covariance + JITTER * scale[..., None] * np.eye(scale.shape[1])))
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(covariance / np.sqrt(scale[:, :, None] * scale[:, None]))
        positive = (vectors * np.maximum(values, LEAST_SHARE)[:, None]) @ np.swapaxes(vectors, 1, 2)
        return np.asarray(np.linalg.cholesky(positive * np.sqrt(scale[:, :, None] * scale[:, None])))


def _gathered(given: SemanticInput, observation: LatentObservation, rows: Index) -> tuple[Array, Array, Array]:
    """(B, n, L) means, (B, n L, r + n l) cross-covariances with tangent vectors, (B, n L, n L) covariances."""
    stack = given.stack
    length, layout = observation.num_dimensions, stack.layout
    batch, count = len(rows), stack.active.shape[1]
    mean = np.zeros((batch, count, length))
    covariance = np.tile(np.eye(count * length), (batch, 1, 1))
    cross = np.zeros((batch, count * length, layout.size(count)))
    parents = stack.rows.parents[rows]
    for parent in np.unique(parents):
        own = np.flatnonzero(parents == parent)
        objects = stack.rows.objects[rows[own]]
        wanted = np.unique(objects[objects >= 0]).tolist()
        found = PredictedDescriptors.of(given.parents[parent], given, wanted, observation)
        for row, places in zip(own, objects, strict=True):
            used = [i for i, place in enumerate(places) if place >= 0 and stack.slots[rows[row], i] == i]
            at = [int(places[i]) for i in used]
            mean[row, used] = found.mean[at]
            here, there = rows_of_blocks(used, length), rows_of_blocks(at, length)
            covariance[row, here[:, None], here] = found.covariance[there[:, None], there]
            poses, origin = (layout.rows([0, *(1 + i for i in which)]) for which in (used, at))
            cross[row, here[:, None], poses] = found.cross[there[:, None], origin]
    return mean, cross, covariance
