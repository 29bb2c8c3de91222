"""Learned likelihood P(f(z) | x_rel, e) of a detection's feature by viewpoint and descriptor, in the plane (Eq. 5.10).

A tight crop carries the direction of view, but neither range nor roll. The elevation is measured with the box; the
azimuth is that of the camera in the object's frame, so that it depends on the poses x of the robot and o of the object.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from semantic_slam.geometry.arrays import Array, squared_norms
from semantic_slam.geometry.log_space import LOG_2PI
from semantic_slam.inference.models.latent.detection_features import DetectionFeatures
from semantic_slam.inference.models.planar.frames import camera_in_object
from semantic_slam.inference.states.spaces import LEAST_DISTANCE_M
from semantic_slam.latent.model import DescriptorBelief, DescriptorModel
from semantic_slam.viewpoint.model import Viewpoints


@dataclass(frozen=True, kw_only=True)
class LatentLinearisation:
    """log p = log_normaliser - |residual|^2 / 2 at B states, with Jacobians in the tangent spaces there."""

    residual: Array  # (B, F) whitened
    by_robot: Array  # (B, F, 3)
    by_object: Array  # (B, F, 3)
    by_descriptor: Array  # (B, F, L)
    by_azimuth: Array  # (B, F)
    log_normaliser: Array  # (B,)

    def log_density(self) -> Array:
        """(B,) log density of the features, in nats."""
        return self.log_normaliser - 0.5 * squared_norms(self.residual)


@dataclass(frozen=True)
class LatentObservation:
    """A descriptor model, and the prior of descriptors before any view.

    ``tempering`` N: each density enters with power 1 / N, so that N views count as one.
    """

    model: DescriptorModel
    tempering: float = 1.0
    known: dict[int, DescriptorBelief] = field(default_factory=dict)  # object id -> prior of a map, B = 1

    @property
    def num_dimensions(self) -> int:
        """L, the number of components of a descriptor."""
        return self.model.num_dimensions

    @cached_property
    def prior(self) -> DescriptorBelief:
        """Prior of the descriptor of an object that no map knows, B = 1."""
        return self.model.prior

    def prior_of(self, object_id: int) -> DescriptorBelief:
        """Prior of an object's descriptor before its first view, B = 1."""
        return self.known.get(object_id, self.prior)

    def linearise(self, features: DetectionFeatures, x: Array, o: Array, e: Array) -> LatentLinearisation:
        """Linearised residual of B collected detections, at (B, 3) robots and objects and (B, L) descriptors."""
        v = camera_in_object(x, o, features.sensor)
        part = self.by_azimuth(features, np.arctan2(v[:, 1], v[:, 0]), e)
        turn = _azimuth_by_poses(v, x[:, 2] - o[:, 2], features.sensor)
        by_poses = part.by_azimuth[:, :, None] * turn[:, None]
        return LatentLinearisation(
            residual=part.residual,
            by_robot=by_poses[:, :, :3],
            by_object=by_poses[:, :, 3:],
            by_descriptor=part.by_descriptor,
            by_azimuth=part.by_azimuth,
            log_normaliser=part.log_normaliser,
        )

    def by_azimuth(self, features: DetectionFeatures, azimuth: Array, e: Array) -> LatentLinearisation:
        """Linearised residual at (B,) azimuths that are given; its Jacobians by poses are empty."""
        elevation = features.elevation_rad
        if len(elevation) != len(azimuth):
            elevation = np.repeat(elevation, len(azimuth))
        prediction = self.model.predict(Viewpoints(azimuth, elevation, azimuth), e)  # the range does not count
        variance = prediction.sigma**2 + features.variance
        sigma = np.sqrt(self.tempering * variance)
        log_peak = -0.5 * (np.log(variance).sum(axis=-1) + variance.shape[1] * LOG_2PI) / self.tempering
        none = np.zeros((len(azimuth), variance.shape[1], 0))
        return LatentLinearisation(
            residual=(prediction.mean - features.feature) / sigma,
            by_robot=none,
            by_object=none,
            by_descriptor=prediction.by_descriptor / sigma[..., None],
            by_azimuth=prediction.by_direction[:, :, 0] / sigma,
            log_normaliser=np.asarray(log_peak),
        )

    def residuals(self, features: DetectionFeatures, azimuth: Array, e: Array) -> tuple[Array, Array]:
        """(B, S, F) whitened residuals of B detections at (B, S) azimuths and (B, S, L) descriptors.

        The (B, S) log normalisers come with them: log p = log_normaliser - |residual|^2 / 2.
        """
        shape = azimuth.shape
        elevation = np.repeat(features.elevation_rad, shape[1])
        viewpoints = Viewpoints(azimuth.ravel(), elevation, np.ones(azimuth.size))  # the range does not count
        mean, sigma = self.model.mean_and_sigma(viewpoints, e.reshape(azimuth.size, -1))
        variance = sigma.reshape(*shape, -1) ** 2 + features.variance[:, None]
        residual = mean.reshape(variance.shape) - features.feature[:, None]
        residual /= np.sqrt(self.tempering * variance)
        log_peak = np.log(variance).sum(axis=-1) + variance.shape[-1] * LOG_2PI
        return residual, np.asarray(-0.5 * log_peak / self.tempering)


def azimuth_slopes(x: Array, o: Array, sensor: Array) -> Array:
    """(B, 6) Jacobian of the azimuth from which (B, 3) robots see (B, 3) objects, by both poses."""
    return _azimuth_by_poses(camera_in_object(x, o, sensor), x[:, 2] - o[:, 2], sensor)


def _azimuth_by_poses(v: Array, angle: Array, sensor: Array) -> Array:
    """(B, 6) Jacobian of the azimuth of v by the robot's pose and by the object's.

    With the ``angle`` of the robot's heading in the object's frame and t = d azimuth / dv: t R [I, S s] and [-t, -1].
    """
    squared = np.maximum(v[:, 0] ** 2 + v[:, 1] ** 2, LEAST_DISTANCE_M**2)
    across, along = -v[:, 1] / squared, v[:, 0] / squared
    cos, sin = np.cos(angle), np.sin(angle)
    slopes = np.empty((len(v), 6))
    slopes[:, 0] = across * cos + along * sin
    slopes[:, 1] = along * cos - across * sin
    slopes[:, 2] = slopes[:, 1] * sensor[..., 0] - slopes[:, 0] * sensor[..., 1]
    slopes[:, 3], slopes[:, 4], slopes[:, 5] = -across, -along, -1.0
    return slopes
