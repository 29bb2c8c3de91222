"""Parametric two-class viewpoint model of Eq. 4.22, mirror-symmetric; in 3-D by the angle from the object's front."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Flags, Index
from semantic_slam.geometry.se2 import sine_cosine
from semantic_slam.viewpoint.model import Prediction, Viewpoints


@dataclass(frozen=True)
class ParametricModel:
    """h_1 = [a sin^2(t/2) + 1 - a, a - a sin^2(t/2)] over azimuth t; class 2 swaps the components.

    With an elevation, t is the angle to the front: cos t = cos(azimuth) cos(elevation).

    ``alpha`` (a, 0..1) is the strength of the viewpoint dependency. The covariance is (R^T R)^-1 with
    R = ``concentration`` [[1, -0.5], [0, 1]], for every viewpoint.
    """

    alpha: float
    concentration: float
    class_names: tuple[str, ...] = ("class_1", "class_2")
    num_features: int = 2

    def predict(self, classes: Index, viewpoints: Viewpoints) -> Prediction:
        """Eq. 4.22 for (B,) class indices 0 or 1."""
        sine, cosine = sine_cosine(viewpoints.azimuth_rad)
        sign = np.where(classes == 0, 1.0, -1.0)
        count = len(sine)
        mean, jacobian = np.empty((count, 2)), np.zeros((count, 2, 3))
        if viewpoints.elevation_rad.any():
            up, level = sine_cosine(viewpoints.elevation_rad)
            jacobian[:, 0, 1] = 0.5 * self.alpha * sign * cosine * up
            jacobian[:, 1, 1] = -jacobian[:, 0, 1]
            sine, cosine = sine * level, cosine * level
        mean[:, 0] = 0.5 + sign * (0.5 - 0.5 * self.alpha * (1.0 + cosine))
        mean[:, 1] = 1.0 - mean[:, 0]
        jacobian[:, 0, 0] = 0.5 * self.alpha * sign * sine
        jacobian[:, 1, 0] = -jacobian[:, 0, 0]
        covariance = np.array([[1.25, 0.5], [0.5, 1.0]]) / self.concentration**2
        return Prediction(mean, np.broadcast_to(covariance, (count, 2, 2)), jacobian)

    def in_coverage(self, classes: Index, viewpoints: Viewpoints) -> Flags:
        """Always True: the model holds for every viewpoint."""
        return np.ones(len(viewpoints.azimuth_rad), dtype=bool)
