"""The null model's density of semantic measurements: the same whatever is seen, from whatever side."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, Self

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.latent.observation import LatentObservation
from semantic_slam.viewpoint.model import ViewpointModel, Viewpoints, log_density

NUM_AZIMUTHS = 36
"""Number of evenly spaced azimuths around an object over which class models are averaged."""
LEVEL, IN_SPACE = (0.0,), (-0.5, 0.0, 0.5)
"""Elevations [rad] over which they are averaged, in the plane and in space."""
NUM_DESCRIPTORS = 64
"""Number of descriptors drawn from their prior over which a learned likelihood is averaged."""


class KeyframeScores(Protocol):
    """The null model's density of the semantic measurements."""

    def log_density(self, detections: Sequence[Any]) -> float:
        """Log density of the semantic measurements of all detections, in nats."""


@dataclass(frozen=True)
class EvenWords:
    """A uniform distribution over the words of a detector: its labels, and one word for any other label."""

    num_words: int

    def log_density(self, detections: Sequence[Any]) -> float:
        """Log probability of the words of all detections, in nats; it depends on their number alone."""
        return -len(detections) * float(np.log(self.num_words))


@dataclass(frozen=True)
class ScoreDensity:
    """A class-independent Gaussian over semantic features of F components; F = 0: features are not compared."""

    mean: Array  # (F,)
    covariance: Array  # (F, F)
    tempering: float = 1.0  # densities are raised to the power of its inverse

    @classmethod
    def matched(cls, means: Array, covariances: Array, tempering: float) -> Self:
        """Moment match the equally weighted mixture of B Gaussians, means (B, F) and covariances (B, F, F)."""
        spread = np.cov(means, rowvar=False, bias=True).reshape(covariances.shape[1:])
        return cls(means.mean(axis=0), covariances.mean(axis=0) + spread, tempering)

    @classmethod
    def of_classes(cls, model: ViewpointModel, tempering: float, elevations: Sequence[float] = LEVEL) -> Self:
        """Match the mixture of all classes, seen from all azimuths at ``elevations`` [rad], at one metre."""
        classes = np.tile(np.repeat(np.arange(len(model.class_names)), NUM_AZIMUTHS), len(elevations))
        prediction = model.predict(classes, _all_around(len(model.class_names), elevations))
        return cls.matched(prediction.mean, prediction.covariance, tempering)

    @classmethod
    def of_descriptors(cls, latent: LatentObservation) -> Self:
        """Match the mixture of descriptors drawn from their prior, seen from all azimuths at one metre."""
        normals = np.random.default_rng(0).standard_normal((NUM_DESCRIPTORS, latent.num_dimensions))
        draws = latent.prior.mean + latent.prior.sigma * normals
        prediction = latent.model.predict(_all_around(len(draws)), np.repeat(draws, NUM_AZIMUTHS, axis=0))
        return cls.matched(
            prediction.mean, np.eye(prediction.sigma.shape[1]) * prediction.sigma[:, None] ** 2, latent.tempering
        )

    def log_density(self, detections: Sequence[Any]) -> float:
        """Log density of the features of all detections, in nats."""
        if not len(self.mean) or not detections:
            return 0.0
        features = np.array([detection.feature for detection in detections])
        covariances = np.array([detection.feature_covariance for detection in detections])
        return float(log_density(features - self.mean, self.covariance + covariances).sum()) / self.tempering


NO_SCORES = ScoreDensity(np.zeros(0), np.zeros((0, 0)))


def _all_around(count: int, elevations: Sequence[float] = LEVEL) -> Viewpoints:
    """Viewpoints (elevations x count x azimuths) around each of ``count`` objects, at one metre."""
    azimuth = np.tile(np.linspace(-np.pi, np.pi, NUM_AZIMUTHS, endpoint=False), count * len(elevations))
    return Viewpoints(azimuth, np.repeat(elevations, count * NUM_AZIMUTHS), np.ones(len(azimuth)))
