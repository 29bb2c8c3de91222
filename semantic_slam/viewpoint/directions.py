"""Viewing directions of objects: azimuth only, or azimuth and elevation."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array


@dataclass(frozen=True)
class Directions:
    """M viewing directions; without elevations all are taken as of one height, which is ignored."""

    azimuth_rad: Array  # (M,)
    elevation_rad: Array | None = None  # (M,)

    def __len__(self) -> int:
        return len(self.azimuth_rad)

    def cosines(self, others: "Directions") -> Array:
        """(M, B) cosines of the angles to B other directions."""
        around = np.cos(self.azimuth_rad[:, None] - others.azimuth_rad[None, :])
        if self.elevation_rad is None or others.elevation_rad is None:
            return np.asarray(around)
        up, level = np.sin(self.elevation_rad), np.cos(self.elevation_rad)
        found = np.outer(level, np.cos(others.elevation_rad)) * around
        return np.asarray(found + np.outer(up, np.sin(others.elevation_rad)))

    def points(self) -> Array:
        """(M, 2 or 3) points on the unit circle, or on the unit sphere."""
        around = np.stack([np.cos(self.azimuth_rad), np.sin(self.azimuth_rad)], axis=-1)
        if self.elevation_rad is None:
            return around
        return np.column_stack([np.cos(self.elevation_rad)[:, None] * around, np.sin(self.elevation_rad)])
