"""Novelty detection by appearance: whether an image looks, to a network's trunk, like any known object.

The novelty score is the log ratio of two densities over the direction of an image's feature vector: the density of
images of made-up objects over that of images of the known objects. Both are kernel density estimates with von
Mises-Fisher kernels around stored images. Directions are taken in coordinates in which the covariance within classes is
the identity, so that what all images share (rooms, light, inexact boxes) counts little. Features are non-negative means
over feature maps; the square roots of their normalised values (the Hellinger map) remove the image's contrast. The
threshold is given as a false-alarm rate on images of known objects that were held out of the fit.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array

LEAST_NORM = 1e-9
"""Norm below which features count as those of an image that excites nothing."""
CONCENTRATION = 20.0
"""Concentration of the kernels: the best of those tried at detecting held-out made-up objects."""
SAME_NETWORK = 1e-3
"""Largest difference of one image's features between two machines, relative to the largest feature."""

UnitVectors = NDArray[np.float32]
"""Unit vectors in single precision: there are many, and half the memory is half the time."""


@dataclass(frozen=True, kw_only=True)
class KnownAppearance:
    """Fitted appearance: images by K features, in P coordinates where the covariance within classes is the identity."""

    centre: Array  # (K,) mean over the images of the Hellinger map of their features
    scale: Array  # (K,) standard deviation of it
    coordinates: Array  # (K, P)
    known: UnitVectors  # (M, P) of images of known objects
    others: UnitVectors  # (N, P) of images of other things
    known_scores: Array  # (Q,) ascending, novelty of images of known objects held out of the fit
    probe: Array  # (K,) features of the probe image, which identify the network used for the fit

    def __post_init__(self) -> None:
        features, coordinates = self.coordinates.shape
        shapes = {
            "centre": (features,),
            "scale": (features,),
            "coordinates": (features, coordinates),
            "known": (len(self.known), coordinates),
            "others": (len(self.others), coordinates),
            "known_scores": (len(self.known_scores),),
            "probe": (features,),
        }
        for name, shape in shapes.items():
            value = getattr(self, name)
            if value.shape != shape or not value.size or not np.isfinite(value).all():
                raise ValueError(f"'{name}' of the known appearance has a wrong shape or is not finite")
        if not (self.scale > 0.0).all():
            raise ValueError("a scale of the known appearance is not positive")

    def directions(self, features: Array) -> Array:
        """(N, P) unit vectors of (N, K) features."""
        return unit((hellinger(features) - self.centre) / self.scale @ self.coordinates)

    def novelty(self, features: Array) -> Array:
        """(N,) novelty: log density ratios at (N, K) features [nats]; low for known objects."""
        directions = self.directions(features)
        return np.asarray(_log_density(directions, self.others) - _log_density(directions, self.known))

    def limit(self, false_alarms: float) -> float:
        """Novelty threshold exceeded by this share of the images of known objects; with too few, their maximum."""
        return float(np.quantile(self.known_scores, 1.0 - false_alarms, method="higher"))

    def is_about(self, probe: Array) -> bool:
        """Whether ``probe`` (K,), some network's features of the probe image, match the network used for the fit."""
        if probe.shape != self.probe.shape:
            return False
        return bool(np.abs(probe - self.probe).max() <= SAME_NETWORK * max(np.abs(self.probe).max(), LEAST_NORM))


@dataclass(frozen=True)
class KnownPictures:
    """Classifier of images into known objects and others, at a given false-alarm rate."""

    appearance: KnownAppearance
    false_alarms: float  # share of images of known objects that are taken for others

    def recognise(self, feature: Array) -> bool:
        """Whether an image with features (K,) looks like a known object."""
        return bool(self.appearance.novelty(feature[None])[0] <= self.appearance.limit(self.false_alarms))


def hellinger(features: Array) -> Array:
    """(N, K) Hellinger map: square roots of non-negative features normalised by their sum."""
    roots = np.sqrt(np.maximum(features, 0.0))
    return unit(roots)


def unit(vectors: Array) -> Array:
    """(N, K) vectors scaled to length 1; shorter where their norm is below :data:`LEAST_NORM`."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), LEAST_NORM))


def _log_density(directions: Array, kept: UnitVectors) -> Array:
    """(N,) log density of (N, P) unit vectors under kernels around (M, P), up to a common constant."""
    from scipy.special import logsumexp  # deferred: the import is a sixth of a classifier's start time

    return np.asarray(logsumexp(CONCENTRATION * (directions.astype(np.float32) @ kept.T), axis=1) - np.log(len(kept)))


PICTURES = ("known", "others")
"""Fields that hold unit vectors."""
APPEARANCE_FIELDS = tuple(item.name for item in fields(KnownAppearance))
