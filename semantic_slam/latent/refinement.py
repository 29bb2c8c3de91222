"""Model parameters refined together with a SLAM posterior (Eq. 5.20), as a batch over tracks around objects.

The joint posterior is climbed in turns: directions and descriptors of all tracks for fixed parameters (the localisation
problem), then the parameters for fixed directions and descriptors, beside the views that the model was trained on.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from semantic_slam.latent.direction import encoded
from semantic_slam.latent.evaluation import own_descriptors
from semantic_slam.latent.feature_views import FeatureViews, turned
from semantic_slam.latent.latent_model import LatentModel
from semantic_slam.latent.torch_network import exported, imported
from semantic_slam.viewpoint.model import Viewpoints

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Track:
    """K views of one object along a track, and what odometry and priors say of their azimuths."""

    features: Array  # (K, F)
    told: Viewpoints  # (K,) prior means; elevations count as known
    covariance: Array  # (K, K) of the told azimuths [rad^2], drift and common offset in it
    descriptor: Array  # (L,) prior mean of the object's descriptor


@dataclass(frozen=True)
class TrackEstimate:
    """The maximum over one track for fixed parameters."""

    azimuth_rad: Array  # (K,)
    descriptor: Array  # (L,)


@dataclass(frozen=True)
class RefinementSettings:
    """How often and how far the parameters follow the tracks."""

    rounds: int = 3
    steps: int = 150  # of the parameters, each round
    learning_rate: float = 3e-4
    batch_size: int = 256
    replay: float = 1.0  # weight of the views of the original training
    descriptor_sigma: float = 0.5  # of a track's descriptor about its prior mean, in units of the model's prior
    seed: int = 0


def refined(
    model: LatentModel, tracks: Sequence[Track], trained_on: FeatureViews, settings: RefinementSettings
) -> LatentModel:
    """The model with a decoder that explains the tracks too; noise, encoder and instances stay."""
    for turn in range(settings.rounds):
        estimates = [estimate_track(model, track, settings.descriptor_sigma) for track in tracks]
        model = _decoder_step(model, tracks, estimates, trained_on, replace(settings, seed=settings.seed + turn))
    return model


def estimate_track(
    model: LatentModel, track: Track, descriptor_sigma: float = 0.5, iterations: int = 30
) -> TrackEstimate:
    """Levenberg-Marquardt over the K azimuths and the descriptor: features, told azimuths and descriptor prior."""
    count, dimensions = len(track.features), len(track.descriptor)
    precision = np.zeros((count + dimensions, count + dimensions))
    precision[:count, :count] = np.linalg.inv(track.covariance)
    precision[count:, count:] = np.diag((descriptor_sigma * model.prior.sigma[0]) ** -2.0)
    prior = np.concatenate([track.told.azimuth_rad, track.descriptor])
    state, damping = prior.copy(), 1e-2
    cost, gradient, information = _terms(model, track, state, prior, precision)
    for _ in range(iterations):
        step = np.linalg.solve(information + damping * np.diag(np.diag(information)), gradient)
        tried = state + step
        terms = _terms(model, track, tried, prior, precision)
        if terms[0] < cost:
            state, (cost, gradient, information), damping = tried, terms, max(damping / 4.0, 1e-8)
        else:
            damping = min(damping * 5.0, 1e8)
    return TrackEstimate(state[:count], state[count:])


def _terms(
    model: LatentModel, track: Track, state: Array, prior: Array, precision: Array
) -> tuple[float, Array, Array]:
    """Cost, descent direction and information of a track at ``state`` (azimuths, descriptor)."""
    count = len(track.features)
    looked = turned(track.told, state[:count] - track.told.azimuth_rad)
    prediction = model.predict(looked, np.tile(state[count:], (count, 1)))
    residual = ((track.features - prediction.mean) / prediction.sigma).ravel()
    size = prediction.mean.shape[1]
    jacobian = np.zeros((count, size, len(state)))
    jacobian[np.arange(count), :, np.arange(count)] = prediction.by_direction[:, :, 0] / prediction.sigma
    jacobian[:, :, count:] = prediction.by_descriptor / prediction.sigma[:, :, None]
    flat, offset = jacobian.reshape(count * size, -1), prior - state
    cost = 0.5 * float(residual @ residual + offset @ precision @ offset)
    return cost, flat.T @ residual + precision @ offset, flat.T @ flat + precision


def _decoder_step(
    model: LatentModel,
    tracks: Sequence[Track],
    estimates: Sequence[TrackEstimate],
    trained_on: FeatureViews,
    settings: RefinementSettings,
) -> LatentModel:
    """Adam on the decoder: the tracks at their estimates, and batches of the training views."""
    torch.set_num_threads(1)
    torch.manual_seed(settings.seed)
    inputs = np.concatenate(
        [
            np.hstack([encoded(_at(track, estimate)), np.tile(estimate.descriptor, (len(track.features), 1))])
            for track, estimate in zip(tracks, estimates, strict=True)
        ]
    )
    targets = np.concatenate([track.features for track in tracks])
    known = np.hstack([encoded(trained_on.viewpoints), own_descriptors(model, trained_on)])
    sigma = torch.from_numpy(model.noise.tempered).float()
    decoder, generator = imported(model.decoder), np.random.default_rng((settings.seed, 23))
    optimiser = torch.optim.Adam(decoder.parameters(), lr=settings.learning_rate)
    for _ in range(settings.steps):
        loss = torch.zeros(())
        for rows_of, wanted, weight in ((inputs, targets, 1.0), (known, trained_on.features, settings.replay)):
            rows = generator.integers(len(rows_of), size=settings.batch_size)
            mean = decoder(torch.from_numpy(rows_of[rows]).float())
            residual = (torch.from_numpy(wanted[rows]).float() - mean) / sigma
            loss = loss + weight * 0.5 * residual.square().sum(dim=1).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    return replace(model, decoder=exported(decoder))


def _at(track: Track, estimate: TrackEstimate) -> Viewpoints:
    return turned(track.told, estimate.azimuth_rad - track.told.azimuth_rad)
