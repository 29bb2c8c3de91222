"""Posterior of descriptors of many continuations: integrals where they are hardly known, Laplace elsewhere.

The evidence of a continuation is that of its mode times one factor per hardly known object: the integral of the
object's views under all other information (the cavity distribution of expectation propagation), against the same
integral by Laplace. That is exact for a single object and to first order in the correlation between several.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index, squared_norms
from semantic_slam.inference.evidence.laplace import Mode, log_determinants
from semantic_slam.inference.semantics.descriptors.descriptor_problem import DescriptorProblem
from semantic_slam.inference.semantics.descriptors.view_integral import ViewIntegral, share_of_integral

LEAST_RATIO = 1e-6
"""Least ratio of a variance after a view to that before: rounding could make it negative."""


@dataclass(frozen=True, kw_only=True)
class Posterior:
    """Descriptors and directions of view of B continuations of n detections, by blocks of their objects."""

    log_factor: Array  # (B,) of the evidence at the mode
    descriptors: Array  # (B, n, L)
    variances: Array  # (B, n, L)
    directions: Array  # (B, n) standard deviations, radians


def integrated(problem: DescriptorProblem, v: Array, mode: Mode, found: Posterior) -> Posterior:
    """The posterior ``found`` of the modes at ``v``, with integrals as far as descriptors are hardly known after."""
    share = share_of_integral(found.variances, problem.observation.prior.sigma)
    numbers = np.arange(share.shape[1])
    share = np.where(problem.active & (problem.slots == numbers), share, 0.0)
    if not share.any():
        return found
    after = replace(found, descriptors=found.descriptors.copy(), variances=found.variances.copy())
    for batch, views in _of_equal_count(problem, share > 0.0):
        slots, own = views[:, 0], _Cavities.of(problem.select(batch), v[batch], mode.hessian[batch], views)
        log_evidence, y, information = own.integral.at(own.y, own.hessian)
        mean, variance = own.descriptors(y, information)
        weight = share[batch, slots]
        np.add.at(after.log_factor, batch, weight * (log_evidence - own.log_evidence))
        after.descriptors[batch, slots] += weight[:, None] * (mean - after.descriptors[batch, slots])
        after.variances[batch, slots] += weight[:, None] * (variance - after.variances[batch, slots])
    return after


def _of_equal_count(problem: DescriptorProblem, wanted: Flags) -> Iterator[tuple[Index, Index]]:
    """Continuations (M,) and detections (M, k) of the ``wanted`` (B, n) objects that have k views each."""
    batch, slots = np.nonzero(wanted)
    of_object = problem.active[batch] & (problem.slots[batch] == slots[:, None])  # (M, n)
    counts = of_object.sum(axis=1)
    for count in np.unique(counts):
        rows = np.flatnonzero(counts == count)
        yield batch[rows], np.nonzero(of_object[rows])[1].reshape(len(rows), count)


@dataclass(frozen=True, kw_only=True)
class _Cavities:
    """M integrals of one object's views under all other information, and their modes."""

    integral: ViewIntegral
    y: Array  # (M, L + 1)
    hessian: Array  # (M, L + 1, L + 1)
    log_evidence: Array  # (M,) by Laplace

    @classmethod
    def of(cls, problem: DescriptorProblem, v: Array, hessian: Array, views: Index) -> "_Cavities":
        """For the ``views`` (M, k) of one object in each of M continuations, with modes at ``v``."""
        rows, seen = np.arange(len(v)), tuple(problem.seen.take(each) for each in views.T)
        azimuth = problem.azimuths(v)[rows[:, None], views]
        turn, e = azimuth - azimuth[:, :1], problem.descriptors(v)[rows, views[:, 0]]
        parts = [problem.observation.by_azimuth(*of_view, e) for of_view in zip(seen, azimuth.T, strict=True)]
        residual = np.concatenate([part.residual for part in parts], axis=1)
        slopes = [np.concatenate([part.by_descriptor, part.by_azimuth[..., None]], axis=2) for part in parts]
        root = np.linalg.cholesky(_covariances(problem, v, hessian, views[:, 0]))
        jacobian = np.concatenate(slopes, axis=1) @ root
        transposed = np.swapaxes(jacobian, 1, 2)
        size = root.shape[1]
        ratio, axes = np.linalg.eigh(np.eye(size) - transposed @ jacobian)
        wide = axes / np.sqrt(np.maximum(ratio, LEAST_RATIO))[:, None]  # (M, L + 1, L + 1) root of the cavity's
        y = -(np.swapaxes(wide, 1, 2) @ (transposed @ residual[..., None]))[..., 0]
        offset = np.concatenate([e, azimuth[:, :1]], axis=1) - (root @ wide @ y[..., None])[..., 0]
        spread = jacobian @ wide
        hessian = np.eye(size) + np.swapaxes(spread, 1, 2) @ spread
        log_peak = np.sum([part.log_density() for part in parts], axis=0)
        return cls(
            integral=ViewIntegral(
                observation=problem.observation, seen=seen, turn=turn, offset=offset, gain=root @ wide
            ),
            y=y,
            hessian=hessian,
            log_evidence=log_peak - 0.5 * (squared_norms(y) + log_determinants(hessian)),
        )

    def descriptors(self, y: Array, information: Array) -> tuple[Array, Array]:
        """(M, L) means and variances of the descriptors, of Gaussians over y."""
        gain = self.integral.gain[:, :-1]
        spread = np.linalg.solve(information, np.swapaxes(gain, 1, 2))
        mean = self.integral.offset[:, :-1] + (gain @ y[..., None])[..., 0]
        return mean, np.asarray((gain * np.swapaxes(spread, 1, 2)).sum(axis=2))


def _covariances(problem: DescriptorProblem, v: Array, hessian: Array, numbers: Index) -> Array:
    """(M, L + 1, L + 1) covariances of the descriptors and directions of view of the objects at blocks ``numbers``."""
    length, rows = problem.observation.num_dimensions, np.arange(len(v))
    blocks = problem.num_tangent + length * numbers[:, None] + np.arange(length)
    turn = problem.azimuth_gain(v)[rows, numbers]
    gain = np.concatenate([problem.gain[rows[:, None], blocks], turn[:, None]], axis=1)
    return np.asarray(gain @ np.linalg.solve(hessian, np.swapaxes(gain, 1, 2)))
