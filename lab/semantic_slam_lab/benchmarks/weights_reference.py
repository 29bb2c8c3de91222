"""The association posterior of a first keyframe by importance sampling: what the weights are measured against.

An implementation of its own: it shares nothing with the engine but the definition of the belief. Every association
beta has the integral of Eqs. 4.18 and 4.20,

    psi(beta) = int N(y; 0, I) prod_i N(z_i; r, b) 1[object beta_i in sight] sum_c P(c) N(z_i; h_c) dy,

over whitened robot and object states y, classes summed out inside. Each is sampled from a defensive mixture: the
Gaussian at the mode of its geometric part, a wider one there, and the prior. All associations share their draws of
a scrambled Sobol sequence, so that their errors are alike and cancel when psi is normalised.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, ndtri
from scipy.stats import qmc

from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.grid.world import World

PILOT = 1024
"""Samples of every association, before those that cannot matter are left at that."""
NEGLIGIBLE = 1e-6
"""Share of the posterior below which an association gets no more samples."""
SHARES = np.array([0.75, 0.15, 0.1])
"""Shares of the mixture's parts: at the mode, wider, and the prior."""
SCALES = (1.1, 1.8)
"""Standard deviations of the first two parts, relative to the mode's curvature."""
LEAST_REPLICATES = 4
NEWTON_STEPS, CONVERGED = 60, 1e-3
EDGE = (0.1, 0.05)
"""Metres and radians: how softly range and field of view bound the search for a mode."""


@dataclass(frozen=True)
class Reference:
    """B associations of n detections."""

    associations: NDArray[np.int_]  # (B, n)
    probabilities: Array  # (B,)
    effective_sample_size: float  # mean over the posterior of the associations' effective sample sizes
    num_samples: int
    error: float  # total variation to be expected of ``probabilities`` from the scatter of the replicates


def associations_of(num_detections: int, num_objects: int) -> NDArray[np.int_]:
    """(B, n) all ordered choices of distinct objects."""
    return np.array(list(itertools.permutations(range(num_objects), num_detections)))


def total_variation(first: Array, second: Array) -> float:
    """Half the sum of absolute differences of two distributions."""
    return float(0.5 * np.abs(first - second).sum())


def reference_posterior(world: World, seed: int, num_samples: int) -> Reference:
    """Posterior over the associations of the world's first frame."""
    integrand = _Integrand(world)
    associations = associations_of(len(world.frames[0].objects), len(world.object_means))
    centres, roots = integrand.modes(associations)
    pilot, _ = _estimate(integrand, associations, centres, roots, _draws(centres.shape[1], PILOT, seed))
    chosen = np.flatnonzero(pilot - logsumexp(pilot) > np.log(NEGLIGIBLE))
    each = 1 << int(np.log2(max(num_samples / (LEAST_REPLICATES * len(chosen)), 1.0)))
    replicates = max(LEAST_REPLICATES, int(np.ceil(num_samples / (each * len(chosen)))))
    log_psi, effective = np.tile(pilot, (replicates, 1)), np.zeros(len(associations))
    for replicate in range(replicates):
        draws = _draws(centres.shape[1], each, seed + replicate + 1)
        log_psi[replicate, chosen], found = _estimate(
            integrand, associations[chosen], centres[chosen], roots[chosen], draws
        )
        effective[chosen] += found
    single = np.exp(log_psi - logsumexp(log_psi, axis=1, keepdims=True))
    together = logsumexp(log_psi, axis=0)
    probabilities = np.exp(together - logsumexp(together))
    # A replicate is further from the mean of all than that from the truth, by this factor where errors are normal.
    error = np.mean([total_variation(row, probabilities) for row in single]) / np.sqrt(replicates - 1.0)
    used = len(associations) * PILOT + replicates * each * len(chosen)
    return Reference(associations, probabilities, float(probabilities @ effective), used, float(error))


@dataclass(frozen=True)
class _Draws:
    """S standard normals (S, m), the part of the mixture that each belongs to, and their squared lengths."""

    normal: Array
    part: NDArray[np.int_]
    squared: Array


def _draws(size: int, count: int, seed: int) -> _Draws:
    uniform = qmc.Sobol(size + 1, seed=seed).random(count)
    part = np.searchsorted(np.cumsum(SHARES), uniform[:, 0], side="right").clip(0, len(SHARES) - 1)
    normal = ndtri(uniform[:, 1:].clip(1e-12, 1.0 - 1e-12))
    return _Draws(normal, part, (normal**2).sum(axis=1))


def _estimate(
    integrand: "_Integrand", associations: NDArray[np.int_], centres: Array, roots: Array, draws: _Draws
) -> tuple[Array, Array]:
    """(B,) log psi and effective sample sizes."""
    log_psi, effective = np.full(len(associations), -np.inf), np.zeros(len(associations))
    for row, association in enumerate(associations):
        log_weight = _log_weights(integrand, association, centres[row], roots[row], draws)
        largest = log_weight.max()
        if np.isfinite(largest):
            weight = np.exp(log_weight - largest)
            log_psi[row] = largest + np.log(weight.mean())
            effective[row] = weight.sum() ** 2 / (weight**2).sum()
    return log_psi, effective


def _log_weights(
    integrand: "_Integrand", association: NDArray[np.int_], centre: Array, root: Array, draws: _Draws
) -> Array:
    """(S,) log of integrand over proposal; (2 pi)^(-n/2) cancels."""
    scale = np.array([*SCALES, 1.0])[draws.part]
    y = centre + (scale[:, None] * draws.normal) @ root.T
    from_prior = draws.part == len(SCALES)
    y[from_prior] = draws.normal[from_prior]
    squared = draws.squared * scale**2  # lengths as the curvature at the mode measures them
    squared[from_prior] = (np.linalg.solve(root, (y[from_prior] - centre).T) ** 2).sum(axis=0)
    log_root, prior = np.linalg.slogdet(root)[1], -0.5 * (y**2).sum(axis=1)
    log_proposal = np.log(SHARES[-1]) + prior
    for share, s in zip(SHARES, SCALES, strict=False):
        part = np.log(share) - 0.5 * squared / s**2 - len(centre) * np.log(s) - log_root
        log_proposal = np.logaddexp(log_proposal, part)
    return np.asarray(prior + integrand.log_likelihood(y, association) - log_proposal)


class _Integrand:
    """Likelihood of the first frame over whitened states y (S, 3 + 3 n): the robot, then each detection's object."""

    def __init__(self, world: World):
        self.world = world
        self.frame = world.frames[0]
        self.count = len(self.frame.objects)
        mean, covariance = world.predicted_robot()
        self.mean, self.root = mean, np.linalg.cholesky(covariance)
        self.object_sigma = np.sqrt(world.noise.objects)
        noise, concentration = np.array(world.noise.geometry), world.sensor.concentration
        self.geometry_sigma = np.sqrt(noise)
        self.log_geometry = -np.log(2.0 * np.pi) - 0.5 * np.log(noise).sum()
        upper = concentration * np.array([[1.0, -0.5], [0.0, 1.0]])  # R of the semantic noise (R^T R)^-1
        self.whiten = upper
        self.log_semantics = -np.log(2.0 * np.pi) + np.log(np.linalg.det(upper))

    def modes(self, associations: NDArray[np.int_]) -> tuple[Array, Array]:
        """(B, m) modes of prior times geometric likelihood in sight, (B, m, m) roots of their inverse curvature.

        Where the mode is out of sight it is sought at the edge, but with the curvature of the likelihood alone.
        """
        y = self._starts(associations)
        identity = np.eye(y.shape[1])
        damping = np.full(len(y), 1e-3)
        residual, jacobian = self._linearised(y, associations)
        for _ in range(NEWTON_STEPS):
            transposed = np.swapaxes(jacobian, 1, 2)
            gradient = (transposed @ residual[..., None])[..., 0] + y
            damped = transposed @ jacobian + (1.0 + damping[:, None, None]) * identity
            trial = y - np.linalg.solve(damped, gradient[..., None])[..., 0]
            new_residual, new_jacobian = self._linearised(trial, associations)
            better = _energy(trial, new_residual) <= _energy(y, residual)
            longest = np.abs(trial - y).max()
            y = np.where(better[:, None], trial, y)
            residual = np.where(better[:, None], new_residual, residual)
            jacobian = np.where(better[:, None, None], new_jacobian, jacobian)
            damping = np.clip(np.where(better, 0.3 * damping, 5.0 * damping), 1e-9, 1e9)
            if longest < CONVERGED:
                break
        measured = jacobian[:, : 2 * self.count]
        hessian = np.swapaxes(measured, 1, 2) @ measured + identity
        return y, np.swapaxes(np.linalg.inv(np.linalg.cholesky(hessian)), 1, 2)

    def log_likelihood(self, y: Array, association: NDArray[np.int_]) -> Array:
        """(S,) log of everything under the integral but the prior; one association."""
        place, direction = self._robot(y)
        total = np.full(len(y), self.count * (self.log_geometry + self.log_semantics - np.log(2.0)))
        sensor = self.world.sensor
        for i in range(self.count):
            there, facing = self._object(y, i, association[i])
            towards = there - place
            relative, distance = towards * direction.conj(), np.abs(towards)
            total -= 0.5 * (self._geometric_residual(relative, distance, i) ** 2).sum(axis=-1)
            ahead = relative.real >= np.cos(0.5 * sensor.field_of_view_rad) * distance
            total[~(ahead & (distance <= sensor.max_range_m))] = -np.inf
            total += self._log_classes(-(towards * facing.conj()).real / distance, i)
        return total

    def _log_classes(self, cosine: Array, detection: int) -> Array:
        """Log of the sum of exp(-|z - h_c|^2 / 2) over both classes, from the cosine of the viewpoint's azimuth."""
        alpha = self.world.sensor.alpha
        first = 0.5 * alpha * (1.0 - cosine) + 1.0 - alpha
        z, upper = self.frame.features[detection], self.whiten
        squared = []
        for a, b in ((z[0] - first, z[1] - 1.0 + first), (z[0] - 1.0 + first, z[1] - first)):
            squared.append((upper[0, 0] * a + upper[0, 1] * b) ** 2 + (upper[1, 1] * b) ** 2)
        return np.asarray(np.logaddexp(-0.5 * squared[0], -0.5 * squared[1]))

    def _robot(self, y: Array) -> tuple[Array, Array]:
        """Position and direction as complex numbers."""
        return _moved(self.mean, y[..., :3] @ self.root.T)

    def _object(self, y: Array, detection: int, number: NDArray[np.int_]) -> tuple[Array, Array]:
        mean = self.world.object_means[number]
        return _moved(mean, y[..., 3 + 3 * detection : 6 + 3 * detection] * self.object_sigma)

    def _geometric_residual(self, relative: Array, distance: Array, detection: int) -> Array:
        seen = self.frame.geometry[detection]
        turn = np.angle(relative * np.exp(-1j * seen[1]))
        return np.asarray(np.stack([distance - seen[0], turn], axis=-1) / self.geometry_sigma)

    def _residual(self, y: Array, associations: NDArray[np.int_]) -> Array:
        """(B, 4 n) whitened geometric residuals, then by how much limits are passed; one association per row."""
        place, direction = self._robot(y)
        sensor = self.world.sensor
        measured, passed = [], []
        for i in range(self.count):
            relative = (self._object(y, i, associations[:, i])[0] - place) * direction.conj()
            distance, bearing = np.abs(relative), np.abs(np.angle(relative))
            measured.append(self._geometric_residual(relative, distance, i))
            passed.append(np.maximum(distance - sensor.max_range_m, 0.0) / EDGE[0])
            passed.append(np.maximum(bearing - 0.5 * sensor.field_of_view_rad, 0.0) / EDGE[1])
        return np.concatenate([*measured, np.stack(passed, axis=-1)], axis=-1)

    def _linearised(self, y: Array, associations: NDArray[np.int_]) -> tuple[Array, Array]:
        """Residual (B, 4 n) and its central differences (B, 4 n, m)."""
        step, columns = 1e-6, []
        for column in range(y.shape[1]):
            move = step * np.eye(y.shape[1])[column]
            change = self._residual(y + move, associations) - self._residual(y - move, associations)
            columns.append(change / (2.0 * step))
        return self._residual(y, associations), np.stack(columns, axis=-1)

    def _starts(self, associations: NDArray[np.int_]) -> Array:
        """Where the robot stands if its heading is the predicted one and the detections agree on average."""
        seen = self.frame.geometry
        arrows = seen[:, 0] * np.exp(1j * (seen[:, 1] + self.mean[2]))
        objects = self.world.object_means[associations]
        place = (objects[..., 0] + 1j * objects[..., 1] - arrows).mean(axis=1)
        relative = (place - (self.mean[0] + 1j * self.mean[1])) * np.exp(-1j * self.mean[2])
        wanted = np.stack([relative.real, relative.imag, np.zeros(len(place))], axis=-1)
        start = np.zeros((len(associations), 3 + 3 * self.count))
        start[:, :3] = np.linalg.solve(self.root, wanted.T).T
        return start


def _moved(mean: Array, tangent: Array) -> tuple[Array, Array]:
    """Pose (..., 3) times Exp(tangent) (..., 3): position and direction as complex numbers."""
    half = 0.5 * tangent[..., 2]
    turn = np.cos(half) + 1j * np.sin(half)
    facing = np.exp(1j * mean[..., 2])
    chord = (
        turn * (tangent[..., 0] + 1j * tangent[..., 1]) * np.sinc(half / np.pi)
    )  # (e^{i a} - 1) / (i a) is turn sinc
    return mean[..., 0] + 1j * mean[..., 1] + facing * chord, facing * turn**2


def _energy(y: Array, residual: Array) -> Array:
    return np.asarray(0.5 * (y**2).sum(axis=-1) + 0.5 * (residual**2).sum(axis=-1))
