"""What features say of a direction of view or of a descriptor (Eq. 5.6), and how sure the model is of it."""

from dataclasses import dataclass
from functools import reduce

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.levenberg_marquardt import Minimum, minimise
from semantic_slam.geometry.rows import take
from semantic_slam.latent.latent_model import LatentModel
from semantic_slam.latent.model import DescriptorBelief
from semantic_slam.training.latent.views.feature_views import repeated, turned
from semantic_slam.viewpoint.model import Viewpoints

ITERATIONS = 25
LARGEST_STEP_RAD = float(np.deg2rad(12.0))


@dataclass(frozen=True)
class AzimuthEstimate:
    """Where an ascent over the azimuth ended, and how sure the model is of it there."""

    azimuth_rad: Array  # (B,)
    variance: Array  # (B,) rad^2, inverse of the information J^T Sigma^-1 J


def ascend_azimuth(
    model: LatentModel, start: Viewpoints, descriptors: Array, features: Array, sigma: Array | None = None
) -> AzimuthEstimate:
    """Damped Gauss-Newton over the azimuth alone for (B,) starts, (B, L) descriptors and (B, F) features.

    ``sigma`` (F,) stands for the model's own, tempered one. Steps are bounded, which the solver for least squares does
    not do: an ascent should end at the peak that it started below, not at one across a flat part of the circle.
    """
    scale = model.noise.tempered if sigma is None else sigma
    azimuth = np.array(start.azimuth_rad, dtype=np.float64)
    damping = np.full(len(azimuth), 1.0)
    cost, gradient, information = _azimuth_terms(model, start, azimuth, descriptors, features, scale)
    for _ in range(ITERATIONS):
        step = gradient / (information * (1.0 + damping) + 1e-12)
        tried = azimuth + np.clip(step, -LARGEST_STEP_RAD, LARGEST_STEP_RAD)
        new_cost, new_gradient, new_information = _azimuth_terms(model, start, tried, descriptors, features, scale)
        better = new_cost < cost
        azimuth, cost = np.where(better, tried, azimuth), np.where(better, new_cost, cost)
        gradient = np.where(better, new_gradient, gradient)
        information = np.where(better, new_information, information)
        damping = np.clip(np.where(better, damping / 3.0, damping * 4.0), 1e-6, 1e9)
    return AzimuthEstimate(azimuth, 1.0 / np.maximum(information, 1e-12))


def _azimuth_terms(
    model: LatentModel, start: Viewpoints, azimuth: Array, descriptors: Array, features: Array, sigma: Array
) -> tuple[Array, Array, Array]:
    """(B,) half squared error, its descent direction and the information."""
    prediction = model.predict(turned(start, azimuth - start.azimuth_rad), descriptors)
    residual = (features - prediction.mean) / sigma
    slope = prediction.by_direction[:, :, 0] / sigma
    return 0.5 * (residual**2).sum(axis=1), (slope * residual).sum(axis=1), (slope**2).sum(axis=1)


@dataclass(frozen=True)
class DescriptorEstimate(DescriptorBelief):
    """Where an ascent over descriptors ended, and how sure the model is of them there."""

    covariance: Array  # (B, L, L) inverse of the information


def infer_descriptors(
    model: LatentModel, viewpoints: Viewpoints, features: Array, iterations: int = ITERATIONS
) -> DescriptorEstimate:
    """Descriptors of B objects from V views each in known directions: (B * V,) viewpoints, (B, V, F) features.

    Levenberg-Marquardt on all views and the model's prior, from the encoder's guess of each view in turn and from the
    prior; the best end is kept, its covariance the inverse of the information.
    """
    count, views, _ = features.shape
    guesses = model.encode(features.reshape(count * views, -1)).mean.reshape(count, views, -1)
    starts = [*guesses.transpose(1, 0, 2), guesses.mean(axis=1), np.repeat(model.prior.mean, count, axis=0)]
    seen = _SeenObjects(model, _by_object(viewpoints, features), features)
    return _estimate(reduce(Minimum.or_lower, (minimise(seen, start, iterations) for start in starts)))


def ascend_descriptors(
    model: LatentModel, viewpoints: Viewpoints, features: Array, start: Array, iterations: int = ITERATIONS
) -> DescriptorEstimate:
    """Descriptors of B objects from one (B, L) start each, viewpoints and features as in ``infer_descriptors``."""
    seen = _SeenObjects(model, _by_object(viewpoints, features), features)
    return _estimate(minimise(seen, start, iterations))


def _estimate(end: Minimum) -> DescriptorEstimate:
    covariance = np.asarray(np.linalg.inv(end.hessian), dtype=np.float64)
    return DescriptorEstimate(end.y, np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)), covariance)


def _by_object(viewpoints: Viewpoints, features: Array) -> Viewpoints:
    """Viewpoints of all views, (B V,), arranged as (B, V) by object."""
    by_object = features.shape[:2]
    return Viewpoints(
        viewpoints.azimuth_rad.reshape(by_object),
        viewpoints.elevation_rad.reshape(by_object),
        viewpoints.range_m.reshape(by_object),
    )


@dataclass(frozen=True)
class _SeenObjects:
    """Descriptors of B objects as least squares: V views each, and the model's prior."""

    model: LatentModel
    viewpoints: Viewpoints  # (B, V)
    features: Array  # (B, V, F)

    def normal_equations(self, y: Array) -> tuple[Array, Array, Array]:
        count, views, size = self.features.shape
        prior, directions = self.model.prior, self.viewpoints
        flat = Viewpoints(directions.azimuth_rad.ravel(), directions.elevation_rad.ravel(), directions.range_m.ravel())
        prediction = self.model.predict(flat, np.repeat(y, views, axis=0))
        residual = ((self.features.reshape(-1, size) - prediction.mean) / prediction.sigma).reshape(count, -1)
        slope = (prediction.by_descriptor / prediction.sigma[:, :, None]).reshape(count, views * size, -1)
        offset = (y - prior.mean) / prior.sigma
        energy = 0.5 * (residual**2).sum(axis=1) + 0.5 * (offset**2).sum(axis=1)
        gradient = offset / prior.sigma - np.einsum("brl,br->bl", slope, residual)
        return energy, gradient, np.matmul(slope.transpose(0, 2, 1), slope) + np.diag(prior.sigma[0] ** -2)

    def select(self, selection: Index) -> "_SeenObjects":
        return take(self, selection, ("viewpoints", "features"))


def azimuth_in_doubt(
    model: LatentModel, start: Viewpoints, descriptors: DescriptorEstimate, features: Array
) -> AzimuthEstimate:
    """Azimuths of (B,) starts where the (B,) descriptors are estimates themselves: both ascend together.

    To first order this is the ascent under the covariance Sigma + J_e P_e J_e^T of the features.
    """
    precision = np.asarray(np.linalg.inv(descriptors.covariance), dtype=np.float64)
    views = _DoubtfulViews(model, start, descriptors.mean, precision, features)
    end = minimise(views, np.column_stack([start.azimuth_rad, descriptors.mean]), ITERATIONS)
    covariance = np.asarray(np.linalg.inv(end.hessian), dtype=np.float64)
    return AzimuthEstimate(end.y[:, 0], covariance[:, 0, 0])


@dataclass(frozen=True)
class _DoubtfulViews:
    """Azimuth and descriptor of B views together as least squares, the descriptors with Gaussians of their own."""

    model: LatentModel
    viewpoints: Viewpoints  # (B,) starts
    mean: Array  # (B, L) of the descriptors
    precision: Array  # (B, L, L)
    features: Array  # (B, F)

    def normal_equations(self, y: Array) -> tuple[Array, Array, Array]:
        prediction = self.model.predict(turned(self.viewpoints, y[:, 0] - self.viewpoints.azimuth_rad), y[:, 1:])
        residual = (self.features - prediction.mean) / prediction.sigma
        slope = np.concatenate([prediction.by_direction[:, :, :1], prediction.by_descriptor], axis=2)
        slope = slope / prediction.sigma[:, :, None]
        offset = y[:, 1:] - self.mean
        pull = np.einsum("bij,bj->bi", self.precision, offset)
        energy = 0.5 * (residual**2).sum(axis=1) + 0.5 * (offset * pull).sum(axis=1)
        gradient = -np.einsum("bfs,bf->bs", slope, residual)
        gradient[:, 1:] += pull
        hessian = np.matmul(slope.transpose(0, 2, 1), slope)
        hessian[:, 1:, 1:] += self.precision
        return energy, gradient, hessian

    def select(self, selection: Index) -> "_DoubtfulViews":
        return take(self, selection, ("viewpoints", "mean", "precision", "features"))


def azimuth_raster(
    model: LatentModel, viewpoints: Viewpoints, descriptors: Array, features: Array, offsets: Array
) -> Array:
    """(B, A) log-likelihoods up to a constant, with (A,) ``offsets`` [rad] added to each direction's azimuth."""
    raster = np.empty((len(features), len(offsets)))
    sigma = model.noise.tempered
    block = 64
    for start in range(0, len(features), block):
        rows = np.arange(start, min(start + block, len(features)))
        directions = turned(repeated(take(viewpoints, rows), len(offsets)), np.tile(offsets, len(rows)))
        mean = model.mean(directions, np.repeat(descriptors[rows], len(offsets), axis=0))
        residual = (np.repeat(features[rows], len(offsets), axis=0) - mean) / sigma
        raster[rows] = -0.5 * (residual**2).sum(axis=1).reshape(len(rows), -1)
    return raster
