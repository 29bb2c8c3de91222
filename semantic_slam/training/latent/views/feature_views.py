"""Features of views whose instance and direction are known: what a model is fitted, calibrated and judged on."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.geometry.rows import take
from semantic_slam.viewpoint.model import Viewpoints


@dataclass(frozen=True)
class FeatureViews:
    """N views of instances by their index in ``names``."""

    names: tuple[str, ...]
    instance: Index  # (N,)
    viewpoints: Viewpoints
    features: Array  # (N, F)

    def __len__(self) -> int:
        return len(self.instance)

    def chosen(self, rows: Flags | Index) -> "FeatureViews":
        """The views of a mask or of indices."""
        return take(self, rows, ("instance", "viewpoints", "features"))

    def with_features(self, features: Array) -> "FeatureViews":
        """The views with the features of another extractor."""
        return FeatureViews(self.names, self.instance, self.viewpoints, features)


def turned(viewpoints: Viewpoints, by_rad: Array | float) -> Viewpoints:
    """The directions with another azimuth, (B,) or one number added."""
    return Viewpoints(viewpoints.azimuth_rad + by_rad, viewpoints.elevation_rad, viewpoints.range_m)


def repeated(viewpoints: Viewpoints, count: int) -> Viewpoints:
    """Every direction ``count`` times, one after the other."""
    return Viewpoints(
        *(np.repeat(value, count) for value in (viewpoints.azimuth_rad, viewpoints.elevation_rad, viewpoints.range_m))
    )
