"""Evidence and place of one object in the plane by sums over a grid, for a robot that knows where it is."""

from collections.abc import Sequence

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.inference.inputs.detection import Detection


class ObjectQuadrature:
    """Evidence of detections of one object, by sums over a grid of its places, the robot being at the origin."""

    def __init__(self) -> None:
        side = np.linspace(-5.0, 5.0, 1001)
        self.offsets = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1)
        self.cell = (side[1] - side[0]) ** 2
        self.perception = Configuration().perception

    def moments(self, place: np.ndarray, sigma: float, seen: Sequence[Detection]) -> tuple[float, np.ndarray]:
        """Evidence, and the posterior mean of the place."""
        places = place + self.offsets
        density = np.exp(-0.5 * (self.offsets**2).sum(axis=-1) / sigma**2) / (2.0 * np.pi * sigma**2) * self.cell
        for own in seen:
            ranges, bearings = np.hypot(places[..., 0], places[..., 1]), np.arctan2(places[..., 1], places[..., 0])
            for off, scale in (
                (ranges - own.range_m, self.perception.sigma_range_m),
                (bearings - own.bearing_rad, self.perception.sigma_bearing_rad),
            ):
                density = density * np.exp(-0.5 * (off / scale) ** 2) / (np.sqrt(2.0 * np.pi) * scale)
        total = float(density.sum())
        return total, (density[..., None] * places).sum(axis=(0, 1)) / total
