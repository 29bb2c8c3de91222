"""Update of heading mixtures by a view: every mode of every object in one batch of least-squares problems."""

from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index, diagonals
from semantic_slam.geometry.rows import take
from semantic_slam.inference.evidence.laplace import Mode, find_modes
from semantic_slam.inference.models.latent.detection_features import DetectionFeatures
from semantic_slam.inference.models.latent.observation import LatentObservation
from semantic_slam.inference.semantics.descriptors.view_integral import ViewIntegral, share_of_integral
from semantic_slam.inference.states.heading_mixture import KEPT_NATS, HeadingMixture

MAX_ITERATIONS = 8
TOLERANCE = 0.05
"""Expected gain [nats] of a further step below which a mode is converged."""


@dataclass(frozen=True, kw_only=True)
class DirectionalView:
    """One view of an object with known heading modes."""

    modes: HeadingMixture
    view: int  # index of the detection
    bearing_rad: float  # direction from the object to the camera, in map
    sigma_rad: float  # of that direction
    elevation_rad: float | None = None  # of the camera over the object; None: as measured with the box


def updated_mixtures(
    observation: LatentObservation, detections: DetectionFeatures, sightings: list[DirectionalView]
) -> list[tuple[HeadingMixture, float]]:
    """Modes after each view, and the view's log evidence, in one batch."""
    if not sightings:
        return []
    sizes = [len(item.modes.log_weight) for item in sightings]
    repeated = np.repeat(np.arange(len(sightings)), sizes)
    mean = np.concatenate([item.modes.mean for item in sightings])
    covariance = np.concatenate([item.modes.covariance for item in sightings])
    bearing, sigma = (np.array([getattr(item, n) for item in sightings]) for n in ("bearing_rad", "sigma_rad"))
    views = np.array([item.view for item in sightings], dtype=int)[repeated]
    problem = _Directions(
        observation=observation,
        seen=_from_their_heights(detections.take(views), [sightings[at].elevation_rad for at in repeated.tolist()]),
        mean=mean,
        root=np.linalg.cholesky(covariance),
        bearing_rad=bearing[repeated],
        sigma_rad=sigma[repeated],
    )
    mode = find_modes(problem, problem.start(), MAX_ITERATIONS, TOLERANCE)
    moved = _Moved(mode.y, problem.covariances(mode.hessian), mode.log_evidence)
    before = np.concatenate([item.modes.log_weight for item in sightings])
    _integrate(problem, mode, moved, _counting(before + mode.log_evidence, sizes))
    after = problem.states(moved.y)
    found, at = [], 0
    for item, count in zip(sightings, sizes, strict=True):
        rows = slice(at, at + count)
        at += count
        log_evidence = float(np.logaddexp.reduce(item.modes.log_weight + moved.log_evidence[rows]))
        modes = replace(item.modes, mean=after[rows], covariance=moved.covariance[rows])
        found.append((modes.weighted(moved.log_evidence[rows]), log_evidence))
    return found


@dataclass(frozen=True)
class _Moved:
    """B Gaussians after a view, and the view's log evidence by each; filled in place."""

    y: Array  # (B, V)
    covariance: Array  # (B, L + 1, L + 1) of descriptor and heading
    log_evidence: Array  # (B,)


def _counting(log_weight: Array, sizes: list[int]) -> Flags:
    """(B,) components that are near enough to the best of their mixture not to be dropped after the view."""
    best = np.maximum.reduceat(log_weight, np.cumsum([0, *sizes[:-1]]))
    return np.asarray(log_weight >= np.repeat(best, sizes) - KEPT_NATS)


def _integrate(problem: "_Directions", mode: Mode, moved: _Moved, counting: Flags) -> None:
    """Integrals in place of Laplace's approximation, as far as descriptors are hardly known after the view."""
    length = problem.observation.num_dimensions
    variances = diagonals(moved.covariance)[:, :length]
    share = np.where(counting, share_of_integral(variances, problem.observation.prior.sigma), 0.0)
    rows = np.flatnonzero(share)
    if not len(rows):
        return
    part, share = problem.select(rows), share[rows]
    log_evidence, y, information = part.integral().at(mode.y[rows], mode.hessian[rows])
    for all_rows, own in (
        (moved.log_evidence, log_evidence),
        (moved.y, y),
        (moved.covariance, part.covariances(information)),
    ):
        weight = share.reshape(-1, *(1,) * (own.ndim - 1))
        all_rows[rows] += weight * (own - all_rows[rows])


def _from_their_heights(seen: DetectionFeatures, elevations_rad: list[float | None]) -> DetectionFeatures:
    """The features, seen from the elevations that are given."""
    told = [own if given is None else given for own, given in zip(seen.elevation_rad, elevations_rad, strict=True)]
    return replace(seen, elevation_rad=np.array(told))


def _padded(root: Array, size: int) -> Array:
    """(B, size, L + 1) transposed roots above zeros: the bearing error is independent of the object."""
    padded = np.zeros((len(root), size, root.shape[1]))
    padded[:, : root.shape[1]] = np.swapaxes(root, 1, 2)
    return padded


@dataclass(frozen=True, kw_only=True)
class _Directions:
    """B least-squares problems over w ~ N(0, I): (e, heading) = mean + root w, and an error of the bearing."""

    observation: LatentObservation
    seen: DetectionFeatures  # B
    mean: Array  # (B, L + 1)
    root: Array  # (B, L + 1, L + 1)
    bearing_rad: Array  # (B,)
    sigma_rad: Array  # (B,)

    def start(self) -> Array:
        """(B, L + 2) starts, with the encoder's guess of the descriptors where that explains the views better."""
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
        """The chosen heading problems of the batch."""
        return take(self, selection, ("seen", "mean", "root", "bearing_rad", "sigma_rad"))

    def integral(self) -> ViewIntegral:
        """The integrals that the energies' exponentials have."""
        count, size = self.mean.shape
        offset = self.mean.copy()
        offset[:, -1] = self.bearing_rad - self.mean[:, -1]
        gain = np.zeros((count, size, size + 1))
        gain[:, :, :size] = self.root
        gain[:, -1] *= -1.0
        gain[:, -1, -1] = self.sigma_rad
        turn = np.zeros((count, 1))
        return ViewIntegral(observation=self.observation, seen=(self.seen,), turn=turn, offset=offset, gain=gain)

    def covariances(self, hessian: Array) -> Array:
        """(B, L + 1, L + 1) covariances of descriptor and heading."""
        spread = np.linalg.solve(hessian, _padded(self.root, hessian.shape[1]))
        covariances = self.root @ spread[:, : self.mean.shape[1]]
        return np.asarray(0.5 * (covariances + np.swapaxes(covariances, 1, 2)))

    def states(self, w: Array) -> Array:
        """(B, L + 1) descriptors and heading at whitened variables ``w``."""
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
