"""Places of cameras around an object, from which its appearance was or could be seen."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.rows import take
from semantic_slam.viewpoint.directions import Directions


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraPlaces:
    """Directions from an object to M cameras, along the axes of map, and their log distances."""

    azimuths_rad: Array  # (M,)
    elevations_rad: Array  # (M,) 0 in the plane
    log_ranges: Array  # (M,) of distances in metres

    @classmethod
    def one(cls, azimuth_rad: float, log_range: float, elevation_rad: float = 0.0) -> Self:
        """A single place."""
        return cls(
            azimuths_rad=np.array([azimuth_rad]),
            elevations_rad=np.array([elevation_rad]),
            log_ranges=np.array([log_range]),
        )

    @classmethod
    def level(cls, azimuths_rad: Array) -> Self:
        """Places at (M,) azimuths, level with the object and one metre away."""
        return cls(azimuths_rad=azimuths_rad, elevations_rad=0.0 * azimuths_rad, log_ranges=0.0 * azimuths_rad)

    @classmethod
    def none(cls) -> Self:
        """No place at all."""
        return cls.level(np.zeros(0))

    def __len__(self) -> int:
        return len(self.azimuths_rad)

    def take(self, rows: Index) -> "CameraPlaces":
        """The places of a selection."""
        return take(self, rows)

    def with_place(self, other: "CameraPlaces") -> "CameraPlaces":
        """The places with others appended."""
        return CameraPlaces(
            azimuths_rad=np.append(self.azimuths_rad, other.azimuths_rad),
            elevations_rad=np.append(self.elevations_rad, other.elevations_rad),
            log_ranges=np.append(self.log_ranges, other.log_ranges),
        )

    def apart(self, others: "CameraPlaces") -> tuple[Array, Array]:
        """(M, B) cosines of the angles between views from here and from B others, and differences of log distance."""
        return self._directions.cosines(others._directions), self.log_ranges[:, None] - others.log_ranges

    def cells(self, step_rad: float) -> Index:
        """(M, 2) cells of azimuth and elevation."""
        around = np.rint(self.azimuths_rad / step_rad) % round(2.0 * np.pi / step_rad)
        return np.stack([around, np.rint(self.elevations_rad / step_rad)], axis=1).astype(int)

    @property
    def _directions(self) -> Directions:
        return Directions(self.azimuths_rad, self.elevations_rad)
