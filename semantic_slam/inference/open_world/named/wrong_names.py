"""Wrong identities in a keyframe: the likeliest sets of right ones, weighed jointly.

Detections are taken in turn, each conditioned on the right ones before: a pose error offsets all of them, and is no
reason to doubt every name. The sets grow by one linearisation at the prediction.
"""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.geometry.small_matrices import cholesky, forward
from semantic_slam.inference.models.noise.heavy_tail import HeavyTail
from semantic_slam.inference.open_world.joint.linear_evidence import JointInnovation


@dataclass(frozen=True)
class RightNames:
    """B sets of the n detections with right names, heaviest first."""

    right: Flags  # (B, n)
    log_scores: Array  # (B,) log evidence of all detections, wrong ones included
    log_left_out: float  # estimate of the mass of all other sets, relative to the heaviest


@dataclass(frozen=True)
class _Sets:
    """B sets over the first i detections, with what is needed to condition the next one on them."""

    right: Flags  # (B, i)
    log_scores: Array  # (B,)
    root: Array  # (B, 2 i, 2 i) Cholesky factor of residual covariance; identity for wrong ones
    whitened: Array  # (B, 2 i) whitened residuals; 0 for wrong ones

    def take(self, rows: Index) -> "_Sets":
        return _Sets(self.right[rows], self.log_scores[rows], self.root[rows], self.whitened[rows])


def right_names(
    joint: JointInnovation,
    objects: Index,
    log_wrong: Array,
    limit: int,
    gate: float,
    tail: HeavyTail | None = None,
) -> RightNames:
    """At most ``limit`` sets of right names, none more than ``gate`` nats behind the heaviest; n are in ``joint``.

    ``objects`` (n,): the object of each detection if its name is right, at most one detection per object. ``log_wrong``
    (n,): log odds that its name is wrong, times its density if so; -inf: it is right. ``tail``: outlier model of
    detections' errors, a detection being an outlier where that is likelier given those before; None: no outliers.
    """
    sets = _Sets(np.zeros((1, 0), dtype=bool), np.zeros(1), np.zeros((1, 0, 0)), np.zeros((1, 0)))
    behind = -np.inf  # log mass of dropped sets, relative to the heaviest of their size
    for number, log_density in enumerate(log_wrong):
        sets = _extended(sets, joint, objects, number, float(log_density), tail)
        order = np.argsort(-sets.log_scores, kind="stable")
        scores = sets.log_scores[order] - sets.log_scores[order[0]]
        kept = (np.arange(len(order)) < limit) & np.isfinite(scores)
        if number == len(log_wrong) - 1:
            kept &= scores >= -gate
        behind = float(np.logaddexp.reduce(scores[~kept], initial=behind))
        sets = sets.take(order[kept])
    return RightNames(sets.right, sets.log_scores, behind)


def _extended(
    sets: _Sets, joint: JointInnovation, objects: Index, number: int, log_wrong: float, tail: HeavyTail | None
) -> _Sets:
    """Every set with the next detection taken as right, then every set with it taken as wrong."""
    count, known = sets.whitened.shape
    size = len(joint.residual) // len(objects)
    rows = slice(known, known + size)
    cross = np.where(np.repeat(sets.right, size, axis=1)[:, None], joint.covariance[rows, :known], 0.0)
    gain = np.swapaxes(np.linalg.solve(sets.root, np.swapaxes(cross, 1, 2)), 1, 2)
    spread = joint.covariance[rows, rows] - gain @ np.swapaxes(gain, 1, 2)
    residual = joint.residual[rows] - (gain @ sets.whitened[..., None])[..., 0]
    own, whitened, log_right = _weighed(residual, spread, joint.log_normalisers[number])
    if tail is not None:
        wide = spread + tail.added * np.diag(joint.measured[number])
        other, far, log_far = _weighed(residual, wide, joint.log_normalisers[number])
        log_right, log_far = tail.log_rest + log_right, tail.log_share + log_far
        outlier = log_far > log_right
        own, whitened = np.where(outlier[:, None, None], other, own), np.where(outlier[:, None], far, whitened)
        log_right = np.logaddexp(log_right, log_far)
    log_right[(sets.right & (objects[:number] == objects[number])).any(axis=1)] = -np.inf
    root = np.zeros((2 * count, known + size, known + size))
    root[:count, :known, :known] = root[count:, :known, :known] = sets.root
    root[:count, known:, :known], root[:count, known:, known:] = gain, own
    root[count:, known:, known:] = np.eye(size)
    return _Sets(
        np.concatenate([np.tile(sets.right, (2, 1)), np.repeat([[True], [False]], count, axis=0)], axis=1),
        np.concatenate([sets.log_scores + log_right, sets.log_scores + log_wrong]),
        root,
        np.concatenate(
            [
                np.concatenate([sets.whitened, whitened], axis=1),
                np.concatenate([sets.whitened, np.zeros((count, size))], axis=1),
            ]
        ),
    )


def _weighed(residual: Array, spread: Array, log_normaliser: float) -> tuple[Array, Array, Array]:
    """Cholesky factors of ``spread`` (B, c, c), residuals (B, c) whitened by them, and log densities (B,)."""
    root = cholesky(spread)
    whitened = forward(root, residual[..., None])[..., 0]
    log_density = log_normaliser - 0.5 * (whitened**2).sum(axis=1)
    log_density -= np.log(np.einsum("bii->bi", root)).sum(axis=1)
    return root, whitened, log_density
