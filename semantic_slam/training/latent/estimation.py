"""Ascent of the likelihood of Eq. 5.6 from a start: over the direction of view, or over the descriptor."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.latent.latent_model import LatentModel
from semantic_slam.latent.model import DescriptorBelief
from semantic_slam.training.latent.climbing import Climbed, Terms, climb
from semantic_slam.training.latent.feature_views import repeated, turned
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

    ``sigma`` (F,) stands for the model's own, tempered one.
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
    terms = _descriptor_terms(model, viewpoints, features)
    best: Climbed | None = None
    for start in starts:
        end = climb(terms, start, iterations)
        best = end if best is None else best.or_better(end)
    assert best is not None
    return _estimate(best)


def ascend_descriptors(
    model: LatentModel, viewpoints: Viewpoints, features: Array, start: Array, iterations: int = ITERATIONS
) -> DescriptorEstimate:
    """As ``infer_descriptors``, from one (B, L) start alone."""
    return _estimate(climb(_descriptor_terms(model, viewpoints, features), start, iterations))


def _estimate(end: Climbed) -> DescriptorEstimate:
    covariance = np.linalg.inv(end.information)
    return DescriptorEstimate(end.state, np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)), covariance)


def _descriptor_terms(model: LatentModel, viewpoints: Viewpoints, features: Array) -> Terms:
    """Of views and prior together."""
    count, views, size = features.shape
    prior = model.prior

    def terms(descriptors: Array) -> tuple[Array, Array, Array]:
        prediction = model.predict(viewpoints, np.repeat(descriptors, views, axis=0))
        residual = ((features.reshape(-1, size) - prediction.mean) / prediction.sigma).reshape(count, -1)
        slope = (prediction.by_descriptor / prediction.sigma[:, :, None]).reshape(count, views * size, -1)
        offset = (prior.mean - descriptors) / prior.sigma
        cost = 0.5 * (residual**2).sum(axis=1) + 0.5 * (offset**2).sum(axis=1)
        gradient = np.einsum("brl,br->bl", slope, residual) + offset / prior.sigma
        information = np.matmul(slope.transpose(0, 2, 1), slope) + np.diag(prior.sigma[0] ** -2)
        return cost, gradient, information

    return terms


def azimuth_in_doubt(
    model: LatentModel, start: Viewpoints, descriptors: DescriptorEstimate, features: Array
) -> AzimuthEstimate:
    """Azimuths of (B,) starts where the (B,) descriptors are estimates themselves: both ascend together.

    To first order this is the ascent under the covariance Sigma + J_e P_e J_e^T of the features.
    """
    precision = np.linalg.inv(descriptors.covariance)

    def terms(state: Array) -> tuple[Array, Array, Array]:
        prediction = model.predict(turned(start, state[:, 0] - start.azimuth_rad), state[:, 1:])
        residual = (features - prediction.mean) / prediction.sigma
        slope = np.concatenate([prediction.by_direction[:, :, :1], prediction.by_descriptor], axis=2)
        slope = slope / prediction.sigma[:, :, None]
        offset = descriptors.mean - state[:, 1:]
        pull = np.einsum("bij,bj->bi", precision, offset)
        cost = 0.5 * (residual**2).sum(axis=1) + 0.5 * (offset * pull).sum(axis=1)
        gradient = np.einsum("bfs,bf->bs", slope, residual)
        gradient[:, 1:] += pull
        information = np.matmul(slope.transpose(0, 2, 1), slope)
        information[:, 1:, 1:] += precision
        return cost, gradient, information

    end = climb(terms, np.column_stack([start.azimuth_rad, descriptors.mean]), ITERATIONS)
    return AzimuthEstimate(end.state[:, 0], np.linalg.inv(end.information)[:, 0, 0])


def azimuth_raster(
    model: LatentModel, viewpoints: Viewpoints, descriptors: Array, features: Array, offsets: Array
) -> Array:
    """(B, A) log-likelihoods up to a constant, with (A,) ``offsets`` [rad] added to each direction's azimuth."""
    raster = np.empty((len(features), len(offsets)))
    sigma = model.noise.tempered
    block = 64
    for start in range(0, len(features), block):
        rows = np.arange(start, min(start + block, len(features)))
        looked = Viewpoints(viewpoints.azimuth_rad[rows], viewpoints.elevation_rad[rows], viewpoints.range_m[rows])
        directions = turned(repeated(looked, len(offsets)), np.tile(offsets, len(rows)))
        mean = model.mean(directions, np.repeat(descriptors[rows], len(offsets), axis=0))
        residual = (np.repeat(features[rows], len(offsets), axis=0) - mean) / sigma
        raster[rows] = -0.5 * (residual**2).sum(axis=1).reshape(len(rows), -1)
    return raster
