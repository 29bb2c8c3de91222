"""Evidence by importance samples from a mixture of Laplace modes and the prior, in whitened coordinates.

The points are a fixed low-discrepancy set with its mirror image about every mode: neighbours in the enumeration get
the same points, so that their errors cancel in the weights, and nothing depends on who draws them or when. A proposal
that was adapted is sampled with other points than those that it was fitted to, which it would seem to suit too well.
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


@dataclass(frozen=True)
class Drawn:
    """N points drawn from a mixture for one problem, and the logs of two densities there."""

    mixture: Gaussians
    y: Array  # (N, n)
    log_joint: Array  # (N,) of the integrand times the prior's density
    log_proposal: Array  # (N,) of the mixture


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

    Moments of few effective samples in many dimensions are mostly sampling error, and a covariance with that error is
    too narrow in some directions, where samples then miss the tails: moments are shrunk towards the Gaussian that was
    there before. A mode without samples stays where it is, and so does one of which the moments are singular.
    """
    alone = mixture.without_prior()
    _, weights = samples.part()
    parts = np.exp(alone.log_responsibilities(samples.y)) * weights  # (M, N)
    totals = np.maximum(parts.sum(axis=1), 1e-12)
    means: Array = alone.means.copy()
    roots: Array = alone.roots.copy()
    for row, (part, total) in enumerate(zip(parts, totals, strict=True)):
        effective = float(part.sum()) ** 2 / max(float(part @ part), 1e-300)
        with suppress(np.linalg.LinAlgError):
            whitened = (samples.y - means[row]) @ roots[row]
            shift, root = _shrunk_moments(whitened, part / total, effective)
            means[row] += np.linalg.solve(roots[row].T, shift)
            roots[row] = roots[row] @ root
    shares: Array = (1.0 - LEAST_MODE_SHARE) * totals / totals.sum() + LEAST_MODE_SHARE / len(totals)
    return Gaussians(means, roots, np.log((1.0 - PRIOR_SHARE) * shares)).with_prior()


def _shrunk_moments(whitened: Array, weights: Array, effective: float) -> tuple[Array, Array]:
    """Mean (n,) and root (n, n) of the precision of weighted samples (N, n), shrunk towards a standard normal, widened.

    Raises LinAlgError.
    """
    size = whitened.shape[1]
    mean = weights @ whitened
    spread = whitened - mean
    differs = (spread * weights[:, None]).T @ spread - np.eye(size)
    covariance = np.eye(size) + _trust(differs, size * (size + 1), effective) * differs
    return _trust(mean, size, effective) * mean, np.linalg.cholesky(np.linalg.inv(WIDENED * covariance))


def _trust(difference: Array, error: float, effective: float) -> float:
    """Factor on a difference of moments: the share of its sum of squares that is no sampling error (James and Stein).

    ``error``: the expected one of a single sample. Since the difference itself may be of a few samples, the factor is
    not more than their number allows.
    """
    if effective <= 1.0:
        return 0.0
    found = max(float((difference**2).sum()), 1e-300)
    return min(max(0.0, 1.0 - error / effective / found), effective / (effective + len(difference)))


def draw(
    targets: Targets, mixtures: Sequence[Gaussians], num_samples: int, firsts: Sequence[int] | None = None
) -> list[Drawn]:
    """``num_samples`` points for each of K problems, drawn from its mixture.

    Half of them are the mirror images of the others, and each Gaussian of a mixture needs at least one such pair.
    ``firsts`` (K,): number of the quasi-random point with which each begins; None: all with the first.
    """
    total = num_samples // 2
    points = np.empty((len(mixtures), 2 * total, mixtures[0].means.shape[-1]))
    log_proposal = np.empty(points.shape[:2])
    drawn: list[Gaussians] = list(mixtures)
    alike: dict[tuple[int, tuple[int, ...]], list[int]] = {}
    for row, (mixture, first) in enumerate(zip(mixtures, firsts or [0] * len(mixtures), strict=True)):
        alike.setdefault((first, _pairs(mixture, total)), []).append(row)
    for (first, counts), rows in alike.items():
        means, roots = (np.array([getattr(mixtures[row], part) for row in rows]) for part in ("means", "roots"))
        points[rows] = _points(means, roots, counts, first)
        together = Gaussians(means, roots, np.log(np.array(counts) / total))
        log_proposal[rows] = finite_log_sum_exp(together.log_densities(points[rows]), axis=-2)
        for at, row in enumerate(rows):
            drawn[row] = Gaussians(means[at], roots[at], together.log_shares)
    log_joint = targets.log_target(points.reshape(-1, points.shape[-1])).reshape(log_proposal.shape)
    log_joint -= 0.5 * squared_norms(points) + 0.5 * points.shape[-1] * np.log(2.0 * np.pi)
    return [Drawn(*own) for own in zip(drawn, points, log_joint, log_proposal, strict=True)]


def weighed(sets: Sequence[Drawn]) -> Samples:
    """The samples of one problem from several mixtures, each weighed against all of these (balance heuristic).

    A mixture that misses a tail does no harm where another has it (deterministic mixture: Veach and Guibas, 1995; Owen
    and Zhou, 2000), so that none is chosen. To keep the one with the most even weights would prefer what misses tails.
    """
    if len(sets) == 1:
        return Samples(sets[0].y, sets[0].log_joint - sets[0].log_proposal)
    y, log_joint = np.concatenate([own.y for own in sets]), np.concatenate([own.log_joint for own in sets])
    log_proposal = [
        np.log(len(own.y) / len(y)) + finite_log_sum_exp(own.mixture.log_densities(y), axis=-2) for own in sets
    ]
    return Samples(y, log_joint - np.logaddexp.reduce(log_proposal, axis=0))


def _pairs(mixture: Gaussians, total: int) -> tuple[int, ...]:
    """(M,) number of antithetic pairs of points of each Gaussian, at least one; the heaviest ones take the remainder.

    ``total`` is at least M. What rounding gave too much is taken from the heaviest Gaussian, as long as it has a pair
    left, and then from the next one.
    """
    counts = np.maximum(1, np.round(total * np.exp(mixture.log_shares))).astype(int)
    for heaviest in np.argsort(-counts, kind="stable"):
        counts[heaviest] = max(1, counts[heaviest] + total - counts.sum())
    return tuple(counts.tolist())


def _points(means: Array, roots: Array, pairs: tuple[int, ...], first: int) -> Array:
    """(K, N, n) points of K mixtures (K, M, n), with ``pairs`` (M,) antithetic pairs from each Gaussian.

    Each Gaussian begins with quasi-random point number ``first``.
    """
    parts, inverse = [], np.linalg.inv(roots)
    for number, count in enumerate(pairs):
        half = normal_points(first + count, means.shape[-1])[first:] @ inverse[:, number]
        centre = means[:, number, None]
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
