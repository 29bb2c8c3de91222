"""Features of one class seen from known directions: the data that a viewpoint model is fitted to."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.rows import Selection, take
from semantic_slam.viewpoint.directions import Directions

FOLDS = 3
"""Parts of the views, each of which is left out of a fit once."""
LARGEST_FEATURE = 1e6
"""Size of a feature component beyond which it is no score; squares of much larger ones overflow."""


@dataclass(frozen=True)
class ClassSamples:
    """M views of one class, S draws of the nuisances (background, light, box) in each, F feature components."""

    azimuth_rad: Array  # (M,)
    features: Array  # (M, S, F) mean over the dropout passes
    feature_covariances: Array  # (M, S, F, F) over the dropout passes
    elevation_rad: Array | None = None  # (M,) None: a nuisance, too
    appearances: Array | None = None  # (M, S, K) the trunk's features; None: the pictures are not there any more
    stamps_ns: NDArray[np.int64] | None = None  # (M,) of a drive; None: views of a turntable

    @property
    def directions(self) -> Directions:
        """Directions of the views, by both angles where heights are told apart."""
        return Directions(self.azimuth_rad, self.elevation_rad)

    @property
    def folds(self) -> Index:
        """(M,) number of the fold, of ``FOLDS``, in which each view is left out.

        Views of a drive are left out by thirds in the order of time: a frame shares object, light and the error of its
        box with the frames before and after it, so that the fit knows every third frame by these. Views of a turntable
        have light and box drawn for each direction, and every third direction is left out.
        """
        count = self.azimuth_rad.size
        if self.stamps_ns is None:
            return np.arange(count) % FOLDS
        places = np.empty(count, dtype=int)
        places[np.argsort(self.stamps_ns, kind="stable")] = np.arange(count)
        return places * FOLDS // count

    @property
    def left_out(self) -> str:
        """What a fold is, in words."""
        return "every third direction" if self.stamps_ns is None else "thirds by time"

    def select(self, views: Selection) -> "ClassSamples":
        """The views with these indices or under this mask."""
        return take(self, views)


def check_samples(samples: dict[str, ClassSamples], num_features: int) -> None:
    """Raises InputError where a model cannot be fitted to the samples of a class."""
    if not samples:
        raise InputError("samples: no class; give views of one at least")
    for name, own in samples.items():
        fault = _fault(own, num_features)
        if fault:
            raise InputError(f"samples of class '{name}': {fault}")


def _fault(samples: ClassSamples, num_features: int) -> str:
    """What keeps a model from being fitted, with the remedy; empty where nothing does."""
    views, draws, size = samples.features.shape
    if views < FOLDS:
        return f"fewer than {FOLDS} views; give more, or leave the class out"
    if not draws or not size or size != num_features:
        return f"{draws} draws of {size} features; give one draw at least, of {max(num_features, 1)}"
    angles = samples.azimuth_rad if samples.elevation_rad is None else samples.azimuth_rad + samples.elevation_rad
    if not all(np.isfinite(numbers).all() for numbers in (angles, samples.features, samples.feature_covariances)):
        return "angles, features or covariances that are not finite; leave these views out"
    if np.abs(samples.features).max() > LARGEST_FEATURE:
        return f"features beyond {LARGEST_FEATURE:g}; give scores, or features of their size"
    return ""
