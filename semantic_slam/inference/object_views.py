"""What the views of an object, associated as one hypothesis has it, tell of its class."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.inference.manifold import Manifold

if TYPE_CHECKING:
    from semantic_slam.inference.heading_modes import HeadingModes

Array = NDArray[np.float64]

LEAST_SHARE = 1e-3
"""Semantic views narrow a variance to this share of the geometric one at most."""


@dataclass(frozen=True)
class Correction:
    """How semantic views move and narrow a state's Gaussian, in units of its own standard deviations."""

    shift: Array  # (d,)
    covariance: Array  # (d, d), I where nothing changes

    @classmethod
    def of_samples(cls, deviations: Array, weights: Array) -> "Correction":
        """From (P, d) deviations of samples, P > d, and their (P,) normalised weights.

        Weighted moments are set against the even ones of the same samples, so that their scatter cancels.
        """
        centred = deviations - deviations.mean(axis=0)
        root = np.linalg.cholesky(centred.T @ centred / len(centred))
        whitened = np.linalg.solve(root, centred.T).T
        shift = weights @ whitened
        spread = whitened - shift
        values, vectors = np.linalg.eigh((spread * weights[:, None]).T @ spread)
        return cls(shift, (vectors * np.maximum(values, LEAST_SHARE)) @ vectors.T)

    @classmethod
    def towards(
        cls, manifold: Manifold, states: Array, covariances: Array, samples: Array, weights: Array
    ) -> list["Correction"]:
        """From K Gaussians at ``states`` (K, d) to the moments of (N, K, d) samples with (N,) normalised weights."""
        roots = np.linalg.cholesky(covariances)
        mean = manifold.mean(samples, weights)
        shifts = np.linalg.solve(roots, manifold.local(states, mean)[..., None])[..., 0]
        spread = np.linalg.solve(roots, np.moveaxis(manifold.local(mean[None], samples), 0, -1))  # (K, d, N)
        moments = (spread * weights) @ np.swapaxes(spread, 1, 2)
        return [cls(shift, covariance) for shift, covariance in zip(shifts, moments, strict=True)]

    def applied(self, manifold: Manifold, state: Array, covariance: Array) -> tuple[Array, Array]:
        """A state (d,) and its covariance (d, d), corrected."""
        root = np.linalg.cholesky(covariance)
        return manifold.retract(state, root @ self.shift), root @ self.covariance @ root.T


UNCERTAIN_RAD = 0.2
"""Standard deviation of the direction of view from which on a linear factor of the feature would not do."""


@dataclass(frozen=True)
class DescriptorRecord:
    """What the views of one object tell of its descriptor; later keyframes without it change that little."""

    mean: Array  # (L,)
    variance: Array  # (L,)
    direction_sigma_rad: float  # of the newest view's azimuth
    entering: tuple[tuple[int, Any], ...]  # keyframe and detection of the views whose factors enter with this record
    heading_rad: float | None = None  # of the object, where its views tell that and no map does

    @property
    def is_bent(self) -> bool:
        """Whether the factors that enter have to be exact."""
        return self.direction_sigma_rad > UNCERTAIN_RAD


@dataclass(frozen=True)
class HeadingRecord:
    """An object whose heading no map tells: its modes over descriptor and heading."""

    modes: "HeadingModes"
    pending: tuple[tuple[int, Any], ...]  # keyframe and detection of the views that have no factors yet


@dataclass(frozen=True)
class ObjectViews:
    """The semantic record of one object in one hypothesis; C classes."""

    log_likelihood: Array  # (C,) log p(z_1:k | c) of the object's semantic measurements, tracks averaged out
    mutual_information: float  # nats, between class and the network's weights at the newest view
    in_coverage: bool  # every view lay inside the class models' coverage
    recent: tuple[Any, ...] = ()  # views that later ones correlate with, oldest first
    log_dropped: Array | None = None  # (C,) share of log_likelihood of the views no longer in ``recent``
    dropped: int = 0  # number of those views
    correction: Correction | None = None  # of the object's pose
    descriptor: DescriptorRecord | None = None  # with a learned latent space
    headings: HeadingRecord | None = None


def class_posterior(log_prior: Array, log_likelihood: Array) -> Array:
    """(..., C) probabilities."""
    joint = log_prior + log_likelihood
    weight = np.exp(joint - joint.max(axis=-1, keepdims=True))
    return np.asarray(weight / weight.sum(axis=-1, keepdims=True))
