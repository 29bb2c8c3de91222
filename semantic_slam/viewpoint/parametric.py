"""The mirror-symmetric two-class model of Eq. 4.22."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import broadcast_copy
from semantic_slam.viewpoint.model import Prediction, Viewpoints


@dataclass(frozen=True)
class ParametricModel:
    """h_1 = [a sin^2(t/2) + 1 - a, a - a sin^2(t/2)] over azimuth t; class 2 swaps the components.

    ``alpha`` (a, 0..1) is the strength of the viewpoint dependency. The covariance is (R^T R)^-1 with
    R = ``concentration`` [[1, -0.5], [0, 1]], for every viewpoint.
    """

    alpha: float
    concentration: float
    class_names: tuple[str, ...] = ("class_1", "class_2")
    num_features: int = 2

    def predict(self, classes: NDArray[np.int_], viewpoints: Viewpoints) -> Prediction:
        """Eq. 4.22 for (B,) class indices 0 or 1."""
        azimuth = viewpoints.azimuth_rad
        first = self.alpha * np.sin(azimuth / 2.0) ** 2 + 1.0 - self.alpha
        slope = 0.5 * self.alpha * np.sin(azimuth)
        sign = np.where(classes == 0, 1.0, -1.0)
        mean = np.where((classes == 0)[:, None], np.stack([first, 1 - first], -1), np.stack([1 - first, first], -1))
        jacobian = np.zeros((len(azimuth), 2, 3))
        jacobian[:, 0, 0] = sign * slope
        jacobian[:, 1, 0] = -sign * slope
        covariance = np.array([[1.25, 0.5], [0.5, 1.0]]) / self.concentration**2
        return Prediction(mean, broadcast_copy(covariance, (len(azimuth), 2, 2)), jacobian)

    def in_coverage(self, classes: NDArray[np.int_], viewpoints: Viewpoints) -> NDArray[np.bool_]:
        """Always inside: the model holds for every viewpoint."""
        return np.ones(len(viewpoints.azimuth_rad), dtype=bool)
