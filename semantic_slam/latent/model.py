"""The learned viewpoint-dependent model over descriptors, P(f(z) | x_rel, e) = N(mu(x_rel, e), Sigma) (Eq. 5.10)."""

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

    ``sigma`` is calibrated and tempered already: what a factor graph may use. It counts as constant where the mean is
    linearised.
    """

    mean: Array  # (B, F)
    sigma: Array  # (B, F)
    by_direction: Array  # (B, F, 2) derivative of the mean by azimuth and elevation [1/rad]
    by_descriptor: Array  # (B, F, L) derivative of the mean by the descriptor


class DescriptorModel(Protocol):
    """What inference asks of a learned model; features come with the measurements. No torch behind it.

    Range and roll are not observed by a tight crop: only the direction of ``Viewpoints`` counts.
    """

    @property
    def space(self) -> str:
        """Which space the descriptors are of: models of another name mean other things by the same numbers."""

    @property
    def num_features(self) -> int:
        """F, the number of components of a feature, at most 32."""

    @property
    def num_dimensions(self) -> int:
        """L, the number of components of a descriptor."""

    @property
    def prior(self) -> DescriptorBelief:
        """One Gaussian, B = 1: the descriptors of the instances that the model was trained on."""

    @property
    def class_names(self) -> tuple[str, ...]:
        """(C,) classes that tagged instances ground the space with (Eqs. 5.18, 5.19); none when not grounded."""

    def predict(self, viewpoints: Viewpoints, descriptors: Array) -> LatentPrediction:
        """For (B,) viewpoints and (B, L) descriptors."""

    def encode(self, features: Array) -> DescriptorBelief:
        """First guesses of the descriptors behind (B, F) features, whatever the direction of view (Eq. 5.12)."""

    def class_log_likelihood(self, belief: DescriptorBelief) -> Array:
        """(B, C) log P(e | c) (Eq. 5.19), averaged over each belief."""
