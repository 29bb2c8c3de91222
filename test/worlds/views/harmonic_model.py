"""A small descriptor model with exact means and derivatives: harmonics of the azimuth, linear in the descriptor."""

from dataclasses import dataclass, field

import numpy as np

from semantic_slam.latent.model import DescriptorBelief, LatentPrediction
from semantic_slam.viewpoint.model import Viewpoints

ORDERS = 3


@dataclass(frozen=True)
class HarmonicModel:
    """mu(az, el, e) = sum_h b_h(az) (A_h e + c_h) + 0.3 el, with b the harmonics; the same noise everywhere."""

    num_features: int = 8
    num_dimensions: int = 3
    noise: float = 0.1
    symmetric: bool = False  # even orders alone: both sides of an object look the same
    seed: int = 0
    class_names: tuple[str, ...] = ("first", "second")
    space: str = ""  # no file holds it
    mixing: np.ndarray = field(init=False)
    offset: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        random = np.random.default_rng(self.seed)
        size = 1 + 2 * ORDERS
        object.__setattr__(self, "mixing", random.normal(size=(size, self.num_features, self.num_dimensions)) * 0.4)
        object.__setattr__(self, "offset", random.normal(size=(size, self.num_features)) * 0.4)

    @property
    def prior(self) -> DescriptorBelief:
        return DescriptorBelief(np.zeros((1, self.num_dimensions)), np.ones((1, self.num_dimensions)))

    def predict(self, viewpoints: Viewpoints, descriptors: np.ndarray) -> LatentPrediction:
        basis, slope = self._basis(np.asarray(viewpoints.azimuth_rad))
        amplitudes = np.einsum("hfl,bl->bhf", self.mixing, descriptors) + self.offset
        mean = np.einsum("bh,bhf->bf", basis, amplitudes) + 0.3 * np.asarray(viewpoints.elevation_rad)[:, None]
        by_azimuth = np.einsum("bh,bhf->bf", slope, amplitudes)
        by_direction = np.stack([by_azimuth, np.full_like(by_azimuth, 0.3)], axis=-1)
        by_descriptor = np.einsum("bh,hfl->bfl", basis, self.mixing)
        return LatentPrediction(mean, np.full_like(mean, self.noise), by_direction, by_descriptor)

    def mean_and_sigma(self, viewpoints: Viewpoints, descriptors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        prediction = self.predict(viewpoints, descriptors)
        return prediction.mean, prediction.sigma

    def encode(self, features: np.ndarray) -> DescriptorBelief:
        """Least squares around the circle: the descriptor of the best direction."""
        around = np.arange(0.0, 2.0 * np.pi, np.pi / 36)
        basis, _ = self._basis(around)
        found = []
        for feature in features:
            by_descriptor = np.einsum("bh,hfl->bfl", basis, self.mixing)
            target = feature - np.einsum("bh,hf->bf", basis, self.offset)
            normal = np.swapaxes(by_descriptor, 1, 2) @ by_descriptor + self.noise**2 * np.eye(self.num_dimensions)
            best = np.linalg.solve(normal, np.einsum("bfl,bf->bl", by_descriptor, target)[..., None])[..., 0]
            cost = ((np.einsum("bfl,bl->bf", by_descriptor, best) - target) ** 2).sum(-1)
            cost += self.noise**2 * (best**2).sum(-1)
            found.append(best[np.argmin(cost)])
        return DescriptorBelief(np.array(found), np.full((len(features), self.num_dimensions), 0.5))

    def class_log_likelihood(self, belief: DescriptorBelief) -> np.ndarray:
        """Two classes, about -1 and +1 in the first component; none where the space is not grounded."""
        if not self.class_names:
            return np.zeros((len(belief.mean), 0))
        variance = 0.25 + belief.sigma[:, :1] ** 2
        return -0.5 * (belief.mean[:, :1] - np.array([-1.0, 1.0])) ** 2 / variance - 0.5 * np.log(variance)

    def _basis(self, azimuth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        orders = np.arange(1, ORDERS + 1) * (2 if self.symmetric else 1)
        turns = np.outer(azimuth, orders)
        ones = np.ones((len(azimuth), 1))
        basis = np.concatenate([ones, np.cos(turns), np.sin(turns)], axis=1)
        slope = np.concatenate([0.0 * ones, -orders * np.sin(turns), orders * np.cos(turns)], axis=1)
        return basis, slope
