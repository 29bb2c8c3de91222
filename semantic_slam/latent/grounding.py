"""Class grounding of the latent space: Gaussians P(e | c) (Eqs. 5.18, 5.19)."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.latent.model import DescriptorBelief


@dataclass(frozen=True)
class Grounding:
    """One Gaussian per class with a diagonal covariance (Eq. 5.19)."""

    class_names: tuple[str, ...]
    mean: Array  # (C, L)
    sigma: Array  # (C, L) predictive, for an untagged instance: includes the uncertainty of the mean

    def log_likelihood(self, belief: DescriptorBelief) -> Array:
        """(B, C) log of the integral of N(e; belief) P(e | c)."""
        variance = self.sigma**2 + belief.sigma[:, None, :] ** 2
        squared = (belief.mean[:, None, :] - self.mean) ** 2 / variance
        return np.asarray(-0.5 * (squared + np.log(2.0 * np.pi * variance)).sum(axis=-1))
