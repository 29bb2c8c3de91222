"""Gaussian mixture over an object's descriptor and unknown heading, (e, heading).

A view may fit several headings of its object; for symmetric boxes it fits two exactly. Every cell of the circle starts
with its own Gaussian, which moves to the nearest mode; components far behind the best are dropped.
"""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.states.yaw import Yaw
from semantic_slam.latent.model import DescriptorBelief

CELLS = 36
"""Number of cells of the circle, 10 degrees each."""
CELL_SIGMA_RAD = 2.0 * np.pi / CELLS / np.sqrt(12.0)
KEPT_NATS = 10.0
"""Nats behind the best beyond which a component is dropped."""


@dataclass(frozen=True)
class HeadingMixture:
    """M Gaussians over the descriptor (L components) and the heading of one object."""

    log_weight: Array  # (M,) normalised
    mean: Array  # (M, L + 1), the heading last, radians in map
    covariance: Array  # (M, L + 1, L + 1)

    @classmethod
    def all_around(cls, belief: DescriptorBelief) -> "HeadingMixture":
        """The mixture for a uniform heading; ``belief`` is that of a single descriptor."""
        length = belief.mean.shape[1]
        mean = np.empty((CELLS, length + 1))
        mean[:, :length] = belief.mean
        mean[:, length] = wrap_angle(np.linspace(0.0, 2.0 * np.pi, CELLS, endpoint=False, dtype=np.float64))
        covariance = np.diag(np.append(belief.sigma[0], CELL_SIGMA_RAD) ** 2)
        return cls(np.full(CELLS, -np.log(CELLS)), mean, np.tile(covariance, (CELLS, 1, 1)))

    @classmethod
    def about(cls, belief: DescriptorBelief, heading_rad: float, sigma_rad: float) -> "HeadingMixture":
        """The mixture for a heading prior from a map, mean and standard deviation in radians."""
        mixture = cls.all_around(belief)
        if sigma_rad >= CELL_SIGMA_RAD * CELLS / 2.0:
            return mixture
        centred = np.append(belief.mean[0], heading_rad)
        if sigma_rad < 2.0 * CELL_SIGMA_RAD:
            covariance = np.diag(np.append(belief.sigma[0], sigma_rad) ** 2)
            return cls(np.zeros(1), centred[None], covariance[None])
        away = wrap_angle(mixture.mean[:, -1] - heading_rad)
        return mixture.weighted(-0.5 * (away / sigma_rad) ** 2)

    def weighted(self, log_factor: Array) -> "HeadingMixture":
        """The mixture multiplied by (M,) factors and normalised, without negligible components."""
        log_weight = self.log_weight + log_factor
        kept = log_weight >= log_weight.max() - KEPT_NATS
        log_weight = log_weight[kept]
        return HeadingMixture(log_weight - np.logaddexp.reduce(log_weight), self.mean[kept], self.covariance[kept])

    def best(self) -> tuple[Array, Array, float]:
        """Mean (L + 1,), covariance and weight of the heaviest component merged with its neighbours in heading."""
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

    def yaw(self) -> Yaw:
        """The heading over all modes, as one wrapped normal."""
        turns = np.exp(1j * self.mean[:, -1] - 0.5 * self.covariance[:, -1, -1])
        return Yaw.of_moment(complex(np.exp(self.log_weight) @ turns))

    def descriptor(self) -> tuple[Array, Array]:
        """(L,) mean and variance of the descriptor over all headings."""
        weight, length = np.exp(self.log_weight), self.mean.shape[1] - 1
        mean = weight @ self.mean[:, :length]
        variances = np.einsum("mii->mi", self.covariance)[:, :length]
        return mean, weight @ (variances + (self.mean[:, :length] - mean) ** 2)
