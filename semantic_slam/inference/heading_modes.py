"""A descriptor together with a direction nobody knows: Gaussians over (e, heading), as many as directions stay likely.

Seen all around, a view may fit several headings of its object, symmetric boxes two of them exactly. Every cell of the
circle has a Gaussian of its own, about the mode next to it; those far behind the best are given up.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.laplace import find_modes
from semantic_slam.inference.latent_observation import LatentObservation
from semantic_slam.inference.seen_features import SeenFeatures
from semantic_slam.latent.model import DescriptorBelief

Array = NDArray[np.float64]
Index = NDArray[np.int_]

CELLS = 36
"""All around: 10 degrees each."""
CELL_SIGMA_RAD = 2.0 * np.pi / CELLS / np.sqrt(12.0)
KEPT_NATS = 10.0
"""Behind the best from which on a cell is given up."""
MAX_ITERATIONS = 8
TOLERANCE = 0.05
"""Nats that a further step may be expected to bring where a mode counts as found."""


@dataclass(frozen=True)
class HeadingModes:
    """M Gaussians over descriptor and heading of one object; L."""

    log_weight: Array  # (M,) normalised
    mean: Array  # (M, L + 1), the heading last, radians in map
    covariance: Array  # (M, L + 1, L + 1)

    @classmethod
    def all_around(cls, belief: DescriptorBelief) -> "HeadingModes":
        """Any heading; ``belief`` of one descriptor."""
        length = belief.mean.shape[1]
        mean = np.empty((CELLS, length + 1))
        mean[:, :length] = belief.mean
        mean[:, length] = wrap_angle(np.linspace(0.0, 2.0 * np.pi, CELLS, endpoint=False, dtype=np.float64))
        covariance = np.diag(np.append(belief.sigma[0], CELL_SIGMA_RAD) ** 2)
        return cls(np.full(CELLS, -np.log(CELLS)), mean, np.tile(covariance, (CELLS, 1, 1)))

    @classmethod
    def about(cls, belief: DescriptorBelief, heading_rad: float, sigma_rad: float) -> "HeadingModes":
        """A heading that a map tells."""
        found = cls.all_around(belief)
        if sigma_rad >= CELL_SIGMA_RAD * CELLS / 2.0:
            return found
        centred = np.append(belief.mean[0], heading_rad)
        if sigma_rad < 2.0 * CELL_SIGMA_RAD:
            covariance = np.diag(np.append(belief.sigma[0], sigma_rad) ** 2)
            return cls(np.zeros(1), centred[None], covariance[None])
        away = wrap_angle(found.mean[:, -1] - heading_rad)
        return found.weighted(-0.5 * (away / sigma_rad) ** 2)

    def weighted(self, log_factor: Array) -> "HeadingModes":
        """Multiplied by (M,) factors, normalised, the light ones left out."""
        log_weight = self.log_weight + log_factor
        kept = log_weight >= log_weight.max() - KEPT_NATS
        log_weight = log_weight[kept]
        return HeadingModes(log_weight - np.logaddexp.reduce(log_weight), self.mean[kept], self.covariance[kept])

    def best(self) -> tuple[Array, Array, float]:
        """Mean (L + 1,) and covariance of the heaviest direction, and its weight with what lies beside it."""
        top = int(np.argmax(self.log_weight))
        near = np.abs(wrap_angle(self.mean[:, -1] - self.mean[top, -1])) < 3.0 * 2.0 * np.pi / CELLS
        weight = np.exp(self.log_weight[near])
        share = weight / weight.sum()
        origin = self.mean[top]
        deviation = self.mean[near] - origin
        deviation[:, -1] = wrap_angle(deviation[:, -1])
        shift = share @ deviation
        spread = deviation - shift
        covariance = np.einsum("m,mij->ij", share, self.covariance[near]) + (spread * share[:, None]).T @ spread
        return origin + shift, covariance, float(weight.sum())

    def descriptor(self) -> tuple[Array, Array]:
        """(L,) mean and variance over all directions."""
        weight, length = np.exp(self.log_weight), self.mean.shape[1] - 1
        mean = weight @ self.mean[:, :length]
        own = np.einsum("mii->mi", self.covariance)[:, :length]
        return mean, weight @ (own + (self.mean[:, :length] - mean) ** 2)


@dataclass(frozen=True)
class Sighting:
    """One view of an object whose modes are known; F."""

    modes: HeadingModes
    view: int  # among the detections
    bearing_rad: float  # direction from the object to the camera, in map
    sigma_rad: float  # of that direction


def updated(
    observation: LatentObservation, detections: SeenFeatures, sightings: list[Sighting]
) -> list[tuple[HeadingModes, float]]:
    """Modes after each view, and the view's log evidence: all directions of all sightings in one batch."""
    if not sightings:
        return []
    sizes = [len(item.modes.log_weight) for item in sightings]
    repeated = np.repeat(np.arange(len(sightings)), sizes)
    mean = np.concatenate([item.modes.mean for item in sightings])
    covariance = np.concatenate([item.modes.covariance for item in sightings])
    bearing, sigma = (np.array([getattr(item, n) for item in sightings]) for n in ("bearing_rad", "sigma_rad"))
    views = np.array([item.view for item in sightings], dtype=int)[repeated]
    problem = _Directions(
        observation, detections.take(views), mean, np.linalg.cholesky(covariance), bearing[repeated], sigma[repeated]
    )
    mode = find_modes(problem, problem.start(), MAX_ITERATIONS, TOLERANCE)
    after = problem.states(mode.y)
    size = mean.shape[1]
    spread = np.linalg.solve(mode.hessian[:, :, :], _padded(problem.root, mode.y.shape[1]))
    covariances = problem.root @ spread[:, :size]
    covariances = 0.5 * (covariances + np.swapaxes(covariances, 1, 2))
    found, at = [], 0
    for item, count in zip(sightings, sizes, strict=True):
        rows = slice(at, at + count)
        at += count
        log_evidence = float(np.logaddexp.reduce(item.modes.log_weight + mode.log_evidence[rows]))
        moved = replace(item.modes, mean=after[rows], covariance=covariances[rows])
        found.append((moved.weighted(mode.log_evidence[rows]), log_evidence))
    return found


def _padded(root: Array, size: int) -> Array:
    """(B, size, L + 1) transposed roots above zeros: the view's own angle tells nothing of the object."""
    padded = np.zeros((len(root), size, root.shape[1]))
    padded[:, : root.shape[1]] = np.swapaxes(root, 1, 2)
    return padded


@dataclass(frozen=True)
class _Directions:
    """B least-squares problems over w ~ N(0, I): (e, heading) = mean + root w, and an error of the bearing."""

    observation: LatentObservation
    seen: SeenFeatures  # B
    mean: Array  # (B, L + 1)
    root: Array  # (B, L + 1, L + 1)
    bearing_rad: Array  # (B,)
    sigma_rad: Array  # (B,)

    def start(self) -> Array:
        """(B, L + 2): the descriptors that the encoder guesses where that explains the views better."""
        length = self.mean.shape[1] - 1
        none = np.zeros((len(self.mean), length + 2))
        guess = self.observation.model.encode(self.seen.feature)
        variance = (self.root[:, :length] ** 2).sum(-1)
        step = np.zeros((len(self.mean), length + 1))
        step[:, :length] = variance / (variance + guess.sigma**2) * (guess.mean - self.mean[:, :length])
        encoded = none.copy()
        encoded[:, : length + 1] = np.linalg.solve(self.root, step[..., None])[..., 0]
        costs = [self.normal_equations(each)[0] for each in (none, encoded)]
        return np.where((costs[1] < costs[0])[:, None], encoded, none)

    def select(self, selection: Index) -> "_Directions":
        """Some of them."""
        names = ("mean", "root", "bearing_rad", "sigma_rad")
        some = {name: getattr(self, name)[selection] for name in names}
        return replace(self, seen=self.seen.take(selection), **some)

    def states(self, w: Array) -> Array:
        """(B, L + 1)."""
        size = self.mean.shape[1]
        return np.asarray(self.mean + (self.root @ w[:, :size, None])[..., 0])

    def normal_equations(self, w: Array) -> tuple[Array, Array, Array]:
        """Energy (B,), gradient and Gauss-Newton Hessian."""
        states = self.states(w)
        azimuth = self.bearing_rad + self.sigma_rad * w[:, -1] - states[:, -1]
        part = self.observation.by_azimuth(self.seen, azimuth, states[:, :-1])
        by_state = np.concatenate([part.by_descriptor, -part.by_azimuth[..., None]], axis=2) @ self.root
        jacobian = np.concatenate([by_state, (part.by_azimuth * self.sigma_rad[:, None])[..., None]], axis=2)
        energy = 0.5 * (w**2).sum(-1) - part.log_density()
        transposed = np.swapaxes(jacobian, 1, 2)
        gradient = w + (transposed @ part.residual[..., None])[..., 0]
        return energy, gradient, np.eye(w.shape[1]) + transposed @ jacobian
