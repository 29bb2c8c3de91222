"""Interface of the learned viewpoint-dependent model P(f(z) | x_rel, e) = N(mu(x_rel, e), Sigma) (Eq. 5.10)."""

from dataclasses import dataclass
from typing import Protocol

from semantic_slam.geometry.arrays import Array
from semantic_slam.viewpoint.model import Viewpoints


@dataclass(frozen=True)
class DescriptorBelief:
    """B Gaussians over the descriptor e of L components, with diagonal covariances (Eq. 5.12)."""

    mean: Array  # (B, L)
    sigma: Array  # (B, L)


@dataclass(frozen=True)
class LatentPrediction:
    """Distribution of the feature f(z) at B viewpoints and descriptors; F components.

    ``sigma`` is already calibrated and tempered for use in a factor graph. It is treated as constant when the mean is
    linearised.
    """

    mean: Array  # (B, F)
    sigma: Array  # (B, F)
    by_direction: Array  # (B, F, 2) derivative of the mean by azimuth and elevation [1/rad]
    by_descriptor: Array  # (B, F, L) derivative of the mean by the descriptor


class DescriptorModel(Protocol):
    """Interface of learned descriptor models for inference, free of torch; features come with the measurements.

    A tight crop does not observe range and roll: only the direction of ``Viewpoints`` matters.
    """

    @property
    def space(self) -> str:
        """Name of the descriptor space: descriptors are comparable only between models of equal name."""

    @property
    def num_features(self) -> int:
        """Number of feature components F, at most 32."""

    @property
    def num_dimensions(self) -> int:
        """Number of descriptor components L."""

    @property
    def prior(self) -> DescriptorBelief:
        """Prior of a descriptor as one Gaussian (B = 1), fitted to the training instances."""

    @property
    def class_names(self) -> tuple[str, ...]:
        """(C,) classes grounded by tagged instances (Eqs. 5.18, 5.19); empty when the space is not grounded."""

    def predict(self, viewpoints: Viewpoints, descriptors: Array) -> LatentPrediction:
        """Predict features for (B,) viewpoints and (B, L) descriptors."""

    def mean_and_sigma(self, viewpoints: Viewpoints, descriptors: Array) -> tuple[Array, Array]:
        """(B, F) mean and sigma of :meth:`predict` without derivatives, for many descriptors of a view."""

    def encode(self, features: Array) -> DescriptorBelief:
        """Initial descriptor estimates from (B, F) features, regardless of the viewing direction (Eq. 5.12)."""

    def class_log_likelihood(self, belief: DescriptorBelief) -> Array:
        """(B, C) log P(e | c) (Eq. 5.19), averaged over each belief."""
