"""Learned latent model for inference: plain numpy, constant diagonal covariance (Eqs. 5.10 and 5.12)."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.latent.change_model import ChangeModel
from semantic_slam.latent.direction import NUM_INPUTS, encoded, encoded_with_derivative
from semantic_slam.latent.grounding import Grounding
from semantic_slam.latent.model import DescriptorBelief, LatentPrediction
from semantic_slam.latent.smooth_network import SmoothNetwork
from semantic_slam.viewpoint.model import Viewpoints

SMALLEST_LOG_SIGMA, LARGEST_LOG_SIGMA = -4.0, 1.5
"""Bounds of the encoder's log standard deviation, relative to the spread of all descriptors."""


@dataclass(frozen=True)
class FeatureNoise:
    """Sigma of Eq. 5.10: spread of calibration views about the mean, and its inflation factor for factor graphs."""

    sigma: Array  # (F,) calibrated per component
    temper: float  # factor that makes the pose covariance inferred from calibration views match its error

    @property
    def tempered(self) -> Array:
        """(F,) standard deviations of the feature to use in a factor graph, inflated by ``temper``."""
        return self.sigma * self.temper


@dataclass(frozen=True)
class Instances:
    """The N training instances and their descriptors (Eq. 5.7)."""

    names: tuple[str, ...]
    descriptors: Array  # (N, L)


@dataclass(frozen=True)
class LatentModel:
    """P(f | x_rel, e) = N(mu(x_rel, e), Sigma), P(e | f), and P(e | c) where grounded. A DescriptorModel."""

    decoder: SmoothNetwork  # encoded direction and descriptor to feature
    encoder: SmoothNetwork  # feature to mean and log sigma of the descriptor
    noise: FeatureNoise  # of detections in rooms
    turntable_noise: FeatureNoise  # of clean turntable images
    instances: Instances
    grounding: Grounding | None = None
    changes: ChangeModel | None = None  # the alternative without object poses (Sec. 5.1); not used by inference
    new_factor: float | None = None  # factor on sigma for objects not in the training set; None: unknown
    formulation: str = "map"
    provenance: dict[str, object] = field(default_factory=dict)
    space: str = ""  # identifies extractor and decoder; empty for a model without a file

    def __post_init__(self) -> None:
        """Validate the parts. Raises ValueError when their sizes do not fit together."""
        features, dimensions = self.num_features, self.num_dimensions
        if self.decoder.num_inputs != NUM_INPUTS + dimensions:
            raise ValueError("the decoder's input is not a direction and a descriptor")
        if (self.encoder.num_inputs, self.encoder.num_outputs) != (features, 2 * dimensions):
            raise ValueError("the encoder does not fit the decoder")
        for noise in (self.noise, self.turntable_noise):
            if noise.sigma.shape != (features,) or not np.all(noise.tempered > 0.0):
                raise ValueError("sigma does not fit the features or is not positive")
        if self.new_factor is not None and not 0.0 < self.new_factor < np.inf:
            raise ValueError("the factor of new objects is not positive")
        if len(self.instances.names) != len(self.instances.descriptors):
            raise ValueError("an instance without a name or without a descriptor")

    @property
    def num_features(self) -> int:
        return self.decoder.num_outputs

    @property
    def num_dimensions(self) -> int:
        return int(self.instances.descriptors.shape[1])

    @cached_property
    def prior(self) -> DescriptorBelief:
        descriptors = self.instances.descriptors
        return DescriptorBelief(descriptors.mean(axis=0)[None], np.maximum(descriptors.std(axis=0), 1e-3)[None])

    @property
    def class_names(self) -> tuple[str, ...]:
        return self.grounding.class_names if self.grounding else ()

    def on_turntable(self) -> "LatentModel":
        """Model for clean turntable images, whose features are less noisy than those of detections."""
        return replace(self, noise=self.turntable_noise)

    def on_new_instances(self) -> "LatentModel":
        """Model for objects not in the training set: sigma is multiplied by ``new_factor`` where that is known."""
        if self.new_factor is None:
            return self
        return replace(self, noise=replace(self.noise, temper=self.noise.temper * self.new_factor))

    def mean(self, viewpoints: Viewpoints, descriptors: Array) -> Array:
        """(B, F) predicted mean features only, for rasters over many viewpoints or descriptors."""
        return self.decoder.value(np.concatenate([encoded(viewpoints), descriptors], axis=1))

    def mean_and_sigma(self, viewpoints: Viewpoints, descriptors: Array) -> tuple[Array, Array]:
        mean = self.mean(viewpoints, descriptors)
        return mean, np.repeat(self.noise.tempered[None], len(mean), axis=0)

    def predict(self, viewpoints: Viewpoints, descriptors: Array) -> LatentPrediction:
        direction, by_direction = encoded_with_derivative(viewpoints)
        tangents = np.repeat(self._tangents, len(descriptors), axis=0)
        tangents[:, :2, :NUM_INPUTS] = by_direction
        inputs = np.concatenate([direction, descriptors], axis=1)
        mean, slopes = self.decoder.value_and_tangents(inputs, tangents)
        slopes = slopes.transpose(0, 2, 1)
        sigma = np.repeat(self.noise.tempered[None], len(mean), axis=0)
        return LatentPrediction(mean, sigma, slopes[:, :, :2], slopes[:, :, 2:])

    @cached_property
    def _tangents(self) -> Array:
        """(1, 2 + L, NUM_INPUTS + L) tangents of the decoder input; the direction entries are filled in per call."""
        directions = np.zeros((2, NUM_INPUTS + self.num_dimensions))
        return np.concatenate([directions, np.eye(self.num_dimensions, len(directions[0]), NUM_INPUTS)])[None]

    def encode(self, features: Array) -> DescriptorBelief:
        outputs = self.encoder.value(np.asarray(features, dtype=np.float64))
        mean, log_sigma = np.split(outputs, 2, axis=1)
        scale = self.prior.sigma
        return DescriptorBelief(mean, scale * np.exp(np.clip(log_sigma, SMALLEST_LOG_SIGMA, LARGEST_LOG_SIGMA)))

    def class_log_likelihood(self, belief: DescriptorBelief) -> Array:
        if self.grounding is None:
            return np.zeros((len(belief.mean), 0))
        return self.grounding.log_likelihood(belief)
