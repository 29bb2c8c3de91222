"""Ascent of the likelihood of Eq. 5.6 from a start: over the direction of view, or over the descriptor."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.latent.feature_views import repeated, turned
from semantic_slam.latent.latent_model import LatentModel
from semantic_slam.latent.model import DescriptorBelief
from semantic_slam.viewpoint.model import Viewpoints

Array = NDArray[np.float64]

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


def infer_descriptors(
    model: LatentModel, viewpoints: Viewpoints, features: Array, iterations: int = ITERATIONS
) -> DescriptorBelief:
    """Descriptors of B objects from V views each in known directions: (B * V,) viewpoints, (B, V, F) features.

    Levenberg-Marquardt on all views and the model's prior, from the encoder's guess of each view in turn and from the
    prior; the best end is kept, its covariance the inverse of the information.
    """
    count, views, _ = features.shape
    guesses = model.encode(features.reshape(count * views, -1)).mean.reshape(count, views, -1)
    starts = [*guesses.transpose(1, 0, 2), guesses.mean(axis=1), np.repeat(model.prior.mean, count, axis=0)]
    best: tuple[Array, Array, Array] | None = None
    for start in starts:
        end, cost, information = _ascend(model, viewpoints, features, start, iterations)
        if best is None:
            best = end, cost, information
            continue
        better = cost < best[1]
        best = (
            np.where(better[:, None], end, best[0]),
            np.where(better, cost, best[1]),
            np.where(better[:, None, None], information, best[2]),
        )
    assert best is not None
    return DescriptorBelief(best[0], _sigma(best[2]))


def ascend_descriptors(
    model: LatentModel, viewpoints: Viewpoints, features: Array, start: Array, iterations: int = ITERATIONS
) -> DescriptorBelief:
    """As ``infer_descriptors``, from one (B, L) start alone."""
    end, _, information = _ascend(model, viewpoints, features, start, iterations)
    return DescriptorBelief(end, _sigma(information))


def _sigma(information: Array) -> Array:
    """(B, L) of (B, L, L)."""
    return np.sqrt(np.diagonal(np.linalg.inv(information), axis1=1, axis2=2))


def _ascend(
    model: LatentModel, viewpoints: Viewpoints, features: Array, start: Array, iterations: int
) -> tuple[Array, Array, Array]:
    """(B, L) ends, (B,) costs and (B, L, L) information there."""
    descriptors, identity = start.copy(), np.eye(start.shape[1])
    damping = np.full(len(start), 1e-2)
    cost, gradient, information = _descriptor_terms(model, viewpoints, features, descriptors)
    for _ in range(iterations):
        diagonal = np.diagonal(information, axis1=1, axis2=2)[:, :, None] * identity
        step = np.linalg.solve(information + damping[:, None, None] * diagonal, gradient[:, :, None])[:, :, 0]
        tried = descriptors + step
        new_cost, new_gradient, new_information = _descriptor_terms(model, viewpoints, features, tried)
        better = new_cost < cost
        descriptors, cost = np.where(better[:, None], tried, descriptors), np.where(better, new_cost, cost)
        gradient = np.where(better[:, None], new_gradient, gradient)
        information = np.where(better[:, None, None], new_information, information)
        damping = np.clip(np.where(better, damping / 4.0, damping * 5.0), 1e-8, 1e8)
    return descriptors, cost, information


def _descriptor_terms(
    model: LatentModel, viewpoints: Viewpoints, features: Array, descriptors: Array
) -> tuple[Array, Array, Array]:
    """(B,) cost, (B, L) descent direction and (B, L, L) information of views and prior together."""
    count, views, size = features.shape
    prediction = model.predict(viewpoints, np.repeat(descriptors, views, axis=0))
    residual = ((features.reshape(-1, size) - prediction.mean) / prediction.sigma).reshape(count, -1)
    slope = (prediction.by_descriptor / prediction.sigma[:, :, None]).reshape(count, views * size, -1)
    prior = model.prior
    offset = (prior.mean - descriptors) / prior.sigma
    cost = 0.5 * (residual**2).sum(axis=1) + 0.5 * (offset**2).sum(axis=1)
    gradient = np.einsum("brl,br->bl", slope, residual) + offset / prior.sigma
    information = np.matmul(slope.transpose(0, 2, 1), slope) + np.diag(prior.sigma[0] ** -2)
    return cost, gradient, information


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
