"""From the scores of a track to class probabilities: models over the direction of view, and what they are told."""

import numpy as np

from semantic_slam.classification.baselines import SCORE_CLIP
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.log_space import finite_log_sum_exp
from semantic_slam.viewpoint.model import Viewpoints
from semantic_slam_lab.studies.real_cabinet.tracks import CLASSES, Track

OURS, MODEL_BASED, SIMPLE_BAYES = "ours", "model_based", "simple_bayes"
METHODS = (OURS, "without_tempering", MODEL_BASED, SIMPLE_BAYES)
TRACK_SAMPLES = 64
LEAST_SIGMA = 1e-3


def single_views(method: str, track: Track, offset_m: Array, sigma_m: float, generator: np.random.Generator) -> Array:
    """(K, C) log likelihood of each view by itself, the camera being taken to be ``offset_m`` (2,) off.

    Our method knows that it may be off by a normal of ``sigma_m`` along each axis, shared by the whole track.
    """
    return np.asarray(likelihoods(method, track, offset_m, sigma_m, generator).mean(axis=0))


def log_posteriors(method: str, track: Track, offset_m: Array, sigma_m: float, generator: np.random.Generator) -> Array:
    """(K, C) log probabilities of the classes after each view, all classes alike before (Eqs. 3.7, 3.19)."""
    if method == SIMPLE_BAYES:
        total = np.cumsum(np.log(np.maximum(track.means[:, : len(CLASSES)], SCORE_CLIP)), axis=0)
    else:
        each = likelihoods(method, track, offset_m, sigma_m, generator)  # (S, K, C)
        total = finite_log_sum_exp(np.cumsum(each, axis=1), axis=0)
    return np.asarray(total - finite_log_sum_exp(total, axis=1)[:, None])


def likelihoods(method: str, track: Track, offset_m: Array, sigma_m: float, generator: np.random.Generator) -> Array:
    """(S, K, C) log likelihoods of the scores at S samples of where the track may be."""
    is_ours = method != MODEL_BASED
    offsets = np.zeros((1, 2))
    if is_ours and sigma_m > 0.0:
        offsets = sigma_m * generator.standard_normal((TRACK_SAMPLES, 2))
    tempering = SemanticModelConfiguration().likelihood_tempering if method == OURS else 1.0
    found = [_log_likelihood(track, track.relative_m + offset_m + offset, is_ours) for offset in offsets]
    return np.array(found) / tempering


def _log_likelihood(track: Track, relative_m: Array, with_dropout: bool) -> Array:
    """(K, C) Gaussian log densities; Model Based takes the mean scores as certain."""
    azimuth = np.arctan2(relative_m[:, 1], relative_m[:, 0])
    rows = [_of_class(track, azimuth, np.full(len(azimuth), number), with_dropout) for number in range(len(CLASSES))]
    return np.stack(rows, axis=1)


def _of_class(track: Track, azimuth_rad: Array, classes: Index, with_dropout: bool) -> Array:
    count = len(azimuth_rad)
    predicted = track.model.predict(classes, Viewpoints(azimuth_rad, np.zeros(count), np.ones(count)))
    covariance = predicted.covariance + LEAST_SIGMA**2 * np.eye(track.means.shape[1])
    if with_dropout:
        covariance = covariance + track.covariances
    root = np.linalg.cholesky(covariance)
    residual = np.linalg.solve(root, (track.means - predicted.mean)[..., None])[..., 0]
    logdet = np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
    return np.asarray(-0.5 * (residual**2).sum(axis=1) - logdet)
