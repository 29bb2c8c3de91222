"""What known objects look like to a network's trunk, and whether a picture looks like any of them.

Novelty is a log ratio of two densities of the direction in which a picture's features lie: that of pictures of things
that are made up, and that of pictures of the known objects. Both are averages of von Mises-Fisher kernels about
pictures that are kept. Directions are those in coordinates in which classes have the identity as their covariance, so
that what all pictures have in common (rooms, light, boxes that are not exact) counts little. Features are non-negative
means over maps; the square roots of their shares (the Hellinger map) take the picture's contrast out of them. What
counts as novel is stated as a share of pictures of known objects that were left out of the fit.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array, Flags

LEAST_NORM = 1e-9
"""Features below it are those of a picture that excites nothing."""
CONCENTRATION = 20.0
"""Concentration of the kernels: of those tried, most made-up things that were left out of the fit are told with it."""
SAME_NETWORK = 1e-3
"""Largest difference between two machines' features of one picture, relative to the largest feature."""

UnitVectors = NDArray[np.float32]
"""They are many: half the memory is half the time."""


@dataclass(frozen=True, kw_only=True)
class KnownAppearance:
    """Pictures by K features, in P coordinates in which the covariance within classes is the identity."""

    centre: Array  # (K,) mean over the pictures of the Hellinger map of their features
    scale: Array  # (K,) standard deviation of it
    coordinates: Array  # (K, P)
    known: UnitVectors  # (M, P) of pictures of known objects
    others: UnitVectors  # (N, P) of pictures of other things
    known_scores: Array  # (Q,) ascending, novelty of pictures of known objects that were left out of the fit
    probe: Array  # (K,) features of the probe picture, which tell the network that the rest is about

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
        """(N,) log ratios of densities at (N, K) features [nats]; what is known lies low."""
        directions = self.directions(features)
        return np.asarray(_log_density(directions, self.others) - _log_density(directions, self.known))

    def limit(self, false_alarms: float) -> float:
        """Novelty that this share of the pictures of known objects exceed; with too few of them their largest one."""
        return float(np.quantile(self.known_scores, 1.0 - false_alarms, method="higher"))

    def is_about(self, probe: Array) -> bool:
        """Whether a network with these features of the probe picture is the one that the appearance was fitted with."""
        if probe.shape != self.probe.shape:
            return False
        return bool(np.abs(probe - self.probe).max() <= SAME_NETWORK * max(np.abs(self.probe).max(), LEAST_NORM))


@dataclass(frozen=True)
class KnownPictures:
    """Tells pictures of known objects from others, at a rate of false alarms."""

    appearance: KnownAppearance
    false_alarms: float  # share of pictures of known objects that are taken for others

    def recognise(self, feature: Array) -> bool:
        """Whether a picture with features (K,) looks like one of a known object."""
        return bool(self.appearance.novelty(feature[None])[0] <= self.appearance.limit(self.false_alarms))


def hellinger(features: Array) -> Array:
    """(N, K) square roots of the shares of non-negative features."""
    roots = np.sqrt(np.maximum(features, 0.0))
    return unit(roots)


def unit(vectors: Array) -> Array:
    """(N, K) vectors of length 1, or 0 where they hardly have one."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), LEAST_NORM))


def _log_density(directions: Array, kept: UnitVectors) -> Array:
    """(N,) of (N, P) unit vectors under kernels about (M, P); up to what all such densities have in common."""
    from scipy.special import logsumexp  # a sixth of what a classifier's start takes, and many look at no novelty

    return np.asarray(logsumexp(CONCENTRATION * (directions.astype(np.float32) @ kept.T), axis=1) - np.log(len(kept)))


def is_novel(appearance: KnownAppearance, features: Array, false_alarms: float) -> Flags:
    """(N,) whether pictures with (N, K) features look like none of a known object."""
    return np.asarray(appearance.novelty(features) > appearance.limit(false_alarms))


PICTURES = ("known", "others")
"""Fields of unit vectors."""
APPEARANCE_FIELDS = tuple(item.name for item in fields(KnownAppearance))
