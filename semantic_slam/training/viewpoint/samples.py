"""Features of one class seen from known directions: the data that a viewpoint model is fitted to."""

from dataclasses import dataclass

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.rows import Selection, take
from semantic_slam.viewpoint.directions import Directions


@dataclass(frozen=True)
class ClassSamples:
    """M views of one class, S draws of the nuisances (background, light, box) in each, F feature components."""

    azimuth_rad: Array  # (M,)
    features: Array  # (M, S, F) mean over the dropout passes
    feature_covariances: Array  # (M, S, F, F) over the dropout passes
    elevation_rad: Array | None = None  # (M,) None: a nuisance, too
    appearances: Array | None = None  # (M, S, K) the trunk's features; None: the pictures are not there any more

    @property
    def directions(self) -> Directions:
        """Directions of the views, by both angles where heights are told apart."""
        return Directions(self.azimuth_rad, self.elevation_rad)

    def select(self, views: Selection) -> "ClassSamples":
        """The views with these indices or under this mask."""
        return take(self, views)
