"""What known objects look like to a network's trunk, and whether a picture looks like any of them.

Novelty is the relative Mahalanobis distance (Ren et al. 2021): the squared distance to the nearest class mean under the
covariance within classes, less that to the mean of all pictures under their whole covariance. Features are non-negative
means over maps; the square roots of their shares (the Hellinger map) take the picture's contrast out of them. What
counts as novel is stated as a share of pictures of known objects that were left out of the fit.
"""

from dataclasses import dataclass, fields

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags

LEAST_NORM = 1e-9
"""Features below it are those of a picture that excites nothing."""
SAME_NETWORK = 1e-3
"""Largest difference between two machines' features of one picture, relative to the largest feature."""


@dataclass(frozen=True, kw_only=True)
class KnownAppearance:
    """C classes of pictures, by K features, in P directions that make both covariances diagonal."""

    centre: Array  # (K,) mean over the pictures of the Hellinger map of their features
    scale: Array  # (K,) standard deviation of it
    directions: Array  # (K, P) to coordinates in which the covariance within classes is the identity
    spread: Array  # (P,) variance of all pictures in those coordinates
    class_means: Array  # (C, P)
    known_scores: Array  # (Q,) ascending, novelty of pictures of known objects that were left out of the fit
    probe: Array  # (K,) features of the probe picture, which tell the network that the rest is about

    def __post_init__(self) -> None:
        known, coordinates = self.directions.shape
        shapes = {
            "centre": (known,),
            "scale": (known,),
            "directions": (known, coordinates),
            "spread": (coordinates,),
            "class_means": (len(self.class_means), coordinates),
            "known_scores": (len(self.known_scores),),
            "probe": (known,),
        }
        for name, shape in shapes.items():
            value = getattr(self, name)
            if value.shape != shape or not value.size or not np.isfinite(value).all():
                raise ValueError(f"'{name}' of the known appearance has a wrong shape or is not finite")
        if not (self.spread > 0.0).all() or not (self.scale > 0.0).all():
            raise ValueError("a variance of the known appearance is not positive")

    def novelty(self, features: Array) -> Array:
        """(N,) relative Mahalanobis distances of (N, K) features; what is known lies low."""
        coordinates = (hellinger(features) - self.centre) / self.scale @ self.directions
        whole = (coordinates**2 / self.spread).sum(axis=1)
        within = [((coordinates - mean) ** 2).sum(axis=1) for mean in self.class_means]
        return np.asarray(np.min(within, axis=0) - whole)

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
    return np.asarray(roots / np.maximum(np.linalg.norm(roots, axis=1, keepdims=True), LEAST_NORM))


def is_novel(appearance: KnownAppearance, features: Array, false_alarms: float) -> Flags:
    """(N,) whether pictures with (N, K) features look like none of a known object."""
    return np.asarray(appearance.novelty(features) > appearance.limit(false_alarms))


APPEARANCE_FIELDS = tuple(item.name for item in fields(KnownAppearance))
