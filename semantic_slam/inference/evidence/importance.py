"""Evidence by importance samples from a mixture of Laplace modes and the prior, in whitened coordinates.

The points are a fixed low-discrepancy set with its mirror image about every mode: neighbours in the enumeration get
the same points, so that their errors cancel in the weights, and nothing depends on who draws them or when.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np
from scipy.special import ndtri

from semantic_slam.geometry.arrays import Array, row_sums, squared_norms
from semantic_slam.geometry.log_space import finite_log_sum_exp
from semantic_slam.interrupts import import_interruptibly

PRIOR_SHARE = 0.1
"""Share of the samples drawn from the prior: no weight can then exceed ten likelihoods."""
LEAST_MODE_SHARE = 0.1
"""Share of the other samples that a mode gets at least, divided by the number of modes."""
WIDENED = 1.1
"""Factor on adapted covariances, because a proposal must not be narrower than its target."""


LEAST_EXPONENT = 10
"""Least exponent of two of the number of quasi-random points that are made at once."""


class Targets(Protocol):
    """The integrand of each of K problems: P(Z | y) P(beta | y) N(y; 0, I)."""

    def log_target(self, y: Array) -> Array:
        """(K N,) log P(Z, beta | y), N rows of each problem after those of the one before."""


@dataclass(frozen=True)
class Gaussians:
    """M Gaussians over n whitened coordinates with their shares of a mixture.

    Densities are also those of several mixtures of as many, which the leading axes count.
    """

    means: Array  # (..., M, n)
    roots: Array  # (..., M, n, n) lower Cholesky factors of the precisions
    log_shares: Array  # (..., M)

    def log_densities(self, y: Array) -> Array:
        """(..., M, B) logs of share times density at (..., B, n)."""
        deviation = (y[..., None, :, :] - self.means[..., None, :]) @ self.roots
        scale = row_sums(np.log(np.diagonal(self.roots, axis1=-2, axis2=-1))) - 0.5 * y.shape[-1] * np.log(2.0 * np.pi)
        return np.asarray((self.log_shares + scale)[..., None] - 0.5 * squared_norms(deviation))

    def log_responsibilities(self, y: Array) -> Array:
        """(M, B) logs of each Gaussian's part in the mixture at y."""
        if len(self.means) == 1:
            return np.zeros((1, len(y)))
        logs = self.log_densities(y)
        return np.asarray(logs - finite_log_sum_exp(logs, axis=-2))

    def without_prior(self) -> "Gaussians":
        """The mixture without its last component, the prior."""
        return Gaussians(self.means[:-1], self.roots[:-1], self.log_shares[:-1])

    def with_prior(self) -> "Gaussians":
        """The mixture with the prior N(0, I) added as its last component."""
        size = self.means.shape[1]
        return Gaussians(
            np.concatenate([self.means, np.zeros((1, size))]),
            np.concatenate([self.roots, np.eye(size)[None]]),
            np.append(self.log_shares, np.log(PRIOR_SHARE)),
        )


@dataclass(frozen=True)
class Samples:
    """N weighted samples: the mean of exp(log_weights) estimates the evidence."""

    y: Array  # (N, n)
    log_weights: Array  # (N,)

    def part(self, log_parts: Array | float = 0.0) -> tuple[float, Array]:
        """Log of the estimate, and (N,) weights that sum to one: of all, or of the part with (N,) logs of shares.

        Weights are 0 where it has none.
        """
        logs = self.log_weights + log_parts
        largest = float(logs.max())
        if not np.isfinite(largest):
            return -np.inf, np.zeros(len(logs))
        weights = np.exp(logs - largest)
        total = float(weights.sum())
        return largest + np.log(total / len(logs)), weights / total


def effective_share(log_weights: Array) -> Array:
    """(...,) effective sample size over the number N of samples, from (..., N); 0 where none has any weight."""
    largest = log_weights.max(axis=-1, keepdims=True)
    some = np.isfinite(largest)
    weights = np.where(some, np.exp(log_weights - np.where(some, largest, 0.0)), 0.0)
    squares = np.maximum((weights**2).sum(axis=-1), 1e-300)
    return np.asarray(weights.sum(axis=-1) ** 2 / squares / log_weights.shape[-1])


def proposal(modes: Array, hessians: Array, log_evidence: Array) -> Gaussians:
    """Laplace modes (M, n) with shares by their evidence (M,), and the prior last."""
    shares: Array = np.exp(log_evidence - np.logaddexp.reduce(log_evidence))
    shares = (1.0 - LEAST_MODE_SHARE) * shares + LEAST_MODE_SHARE / len(modes)
    roots: Array = np.asarray(np.linalg.cholesky(hessians), dtype=np.float64)
    return Gaussians(modes, roots, np.log((1.0 - PRIOR_SHARE) * shares)).with_prior()


def adapted(mixture: Gaussians, samples: Samples) -> Gaussians:
    """The proposal mixture adapted to its samples: each mode gets the weighted moments of its part, the prior stays.

    Moments of few effective samples are shrunk towards the Gaussian they were drawn from. A mode without samples stays
    as it is, and so does one whose covariance is numerically singular: a mode where the robot stands on an object is
    that sharp.
    """
    alone = mixture.without_prior()
    _, weights = samples.part()
    parts = np.exp(alone.log_responsibilities(samples.y)) * weights  # (M, N)
    totals = np.maximum(parts.sum(axis=1), 1e-12)
    size = samples.y.shape[1]
    means: Array = alone.means.copy()
    roots: Array = alone.roots.copy()
    for row, (part, total) in enumerate(zip(parts, totals, strict=True)):
        effective = float(part.sum()) ** 2 / max(float(part @ part), 1e-300)
        trust = effective / (effective + size)
        centre = part @ samples.y / total
        spread = samples.y - centre
        with suppress(np.linalg.LinAlgError):
            before = np.linalg.inv(roots[row] @ roots[row].T)
            covariance = trust * (spread * (part / total)[:, None]).T @ spread + (1.0 - trust) * before
            roots[row] = np.linalg.cholesky(np.linalg.inv(WIDENED * covariance))
            means[row] = trust * centre + (1.0 - trust) * means[row]
    shares: Array = (1.0 - LEAST_MODE_SHARE) * totals / totals.sum() + LEAST_MODE_SHARE / len(totals)
    return Gaussians(means, roots, np.log((1.0 - PRIOR_SHARE) * shares)).with_prior()


def draw(targets: Targets, mixtures: Sequence[Gaussians], num_samples: int) -> list[Samples]:
    """``num_samples`` points for each of K problems, weighed against its whole mixture (balance heuristic).

    Half of them are the mirror images of the others, and each Gaussian of a mixture needs at least one such pair.
    """
    total = num_samples // 2
    points = np.empty((len(mixtures), 2 * total, mixtures[0].means.shape[-1]))
    log_proposal = np.empty(points.shape[:2])
    alike: dict[tuple[int, ...], list[int]] = {}
    for row, mixture in enumerate(mixtures):
        alike.setdefault(_pairs(mixture, total), []).append(row)
    for counts, rows in alike.items():
        means, roots = (np.array([getattr(mixtures[row], part) for row in rows]) for part in ("means", "roots"))
        points[rows] = _points(means, roots, counts)
        drawn = Gaussians(means, roots, np.log(np.array(counts) / total))
        log_proposal[rows] = finite_log_sum_exp(drawn.log_densities(points[rows]), axis=-2)
    log_weights = targets.log_target(points.reshape(-1, points.shape[-1])).reshape(log_proposal.shape) - log_proposal
    log_weights -= 0.5 * squared_norms(points) + 0.5 * points.shape[-1] * np.log(2.0 * np.pi)
    return [Samples(*pair) for pair in zip(points, log_weights, strict=True)]


def _pairs(mixture: Gaussians, total: int) -> tuple[int, ...]:
    """(M,) number of antithetic pairs of points of each Gaussian, at least one; the heaviest ones take the remainder.

    ``total`` is at least M. What rounding gave too much is taken from the heaviest Gaussian, as long as it has a pair
    left, and then from the next one.
    """
    counts = np.maximum(1, np.round(total * np.exp(mixture.log_shares))).astype(int)
    for heaviest in np.argsort(-counts, kind="stable"):
        counts[heaviest] = max(1, counts[heaviest] + total - counts.sum())
    return tuple(counts.tolist())


def _points(means: Array, roots: Array, pairs: tuple[int, ...]) -> Array:
    """(K, N, n) points of K mixtures (K, M, n), with ``pairs`` (M,) antithetic pairs from each Gaussian."""
    parts, inverse = [], np.linalg.inv(roots)
    for number, count in enumerate(pairs):
        half, centre = normal_points(count, means.shape[-1]) @ inverse[:, number], means[:, number, None]
        parts += [centre + half, centre - half]
    return np.concatenate(parts, axis=1)


def normal_points(count: int, size: int) -> Array:
    """(count, size) fixed quasi-random standard normal points; a larger set begins with the same points."""
    return _sequence(size, max(LEAST_EXPONENT, int(np.ceil(np.log2(max(count, 2))))))[:count]


@lru_cache(maxsize=64)
def _sequence(size: int, exponent: int) -> Array:
    import_interruptibly("scipy.stats")  # takes two seconds, and many processes draw nothing
    from scipy.stats import qmc

    uniform = qmc.Sobol(size, scramble=True, seed=size).random_base2(exponent)
    points: Array = ndtri(np.clip(uniform, 1e-10, 1.0 - 1e-10))
    points.setflags(write=False)
    return points
