"""Classification under an uncertain track, incrementally: samples of the track that live on between the views."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from semantic_slam.classification.classifier import (
    Scores,
    SequentialClassifier,
    View,
    averaged,
    log_sum_exp,
    normalised,
)
from semantic_slam.viewpoint.model import Array

Average = Literal["thesis", "evidence"]
"""Over tracks: "thesis" is Eq. 3.20, the posteriors weighted by the geometric belief alone; with "evidence" each
track also counts by how well it explains the scores."""

RELATIVE_JITTER = 1e-9
"""Share of the greatest variance that is added to all: tracks that share one offset have a singular covariance."""


class TrackPosterior(Protocol):
    """p(X_0:k, o | H_k) as locations of the camera relative to the object, K = k + 1 views."""

    def sample(self, count: int, generator: np.random.Generator) -> Array:
        """(count, K, 2) tracks."""

    def extend(self, tracks: Array, generator: np.random.Generator) -> Array:
        """(P, 2) newest locations, drawn given the (P, K - 1, 2) locations before."""

    def log_density(self, tracks: Array) -> Array:
        """(P,) of the first views of the track, (P, k, 2) with k <= K, up to a constant that is the same for a k."""


class GaussianTrack:
    """A Gaussian over all locations of a track, as SLAM's joint marginals give it."""

    def __init__(self, mean_m: Array, covariance: Array) -> None:
        """``mean_m`` (K, 2); ``covariance`` (2 K, 2 K), ordered x0 y0 x1 y1 ..., positive semi-definite."""
        self._mean = np.asarray(mean_m, dtype=np.float64).reshape(-1)
        jitter = RELATIVE_JITTER * np.diagonal(covariance).max()
        self._factor = np.linalg.cholesky(covariance + jitter * np.eye(self._mean.size))

    def sample(self, count: int, generator: np.random.Generator) -> Array:
        """(count, K, 2) tracks."""
        drawn = generator.standard_normal((count, self._mean.size))
        return np.asarray(self._mean + drawn @ self._factor.T).reshape(count, -1, 2)

    def extend(self, tracks: Array, generator: np.random.Generator) -> Array:
        """(P, 2) newest locations given the (P, K - 1, 2) before."""
        shift = self._whitened(tracks).T @ self._factor[-2:, :-2].T
        drawn = generator.standard_normal((len(tracks), 2))
        return np.asarray(self._mean[-2:] + shift + drawn @ self._factor[-2:, -2:].T)

    def log_density(self, tracks: Array) -> Array:
        """(P,) of the first views, in nats but for the factor of 2 pi."""
        whitened = self._whitened(tracks)
        logdet = np.log(np.diagonal(self._factor)[: len(whitened)]).sum()
        return np.asarray(-0.5 * np.square(whitened).sum(axis=0) - logdet)

    def _whitened(self, tracks: Array) -> Array:
        """(2 k, P)."""
        size = 2 * tracks.shape[1]
        centred = (tracks.reshape(len(tracks), size) - self._mean[:size]).T
        return np.asarray(solve_triangular(self._factor[:size, :size], centred, lower=True))


@dataclass(frozen=True)
class Replacement:
    """Which tracks live on, and the log weights of all once fresh ones stand in for the others."""

    fresh: NDArray[np.bool_]  # (P,)
    log_weights: Array  # (P,)


class TrackSampledClassifier:
    """A classifier run on P samples of the track, each with its own class history (Eqs. 3.20, 3.42).

    The samples are extended view by view. Where a new posterior p' has another opinion of the earlier track than the
    posterior p that it was drawn from, the sample's weight changes by p' / p (importance sampling; the ratio in
    Sec. 3.3.4.2 is printed upside down). When the effective sample size falls below ``least_share`` of P, light
    samples give way to fresh tracks of the posterior, for which the earlier views are gone through again.
    """

    def __init__(
        self,
        classifier: SequentialClassifier,
        num_tracks: int,
        generator: np.random.Generator,
        *,
        least_share: float = 0.5,
        average: Average = "thesis",
    ) -> None:
        """``classifier`` tells method and settings; it is not changed."""
        self.classifier = classifier.empty(num_tracks)
        self.log_weights = np.full(num_tracks, -np.log(num_tracks))
        self.tracks_m = np.empty((num_tracks, 0, 2))
        self.replaced = 0  # tracks made anew so far
        self._generator, self._least_share, self._average = generator, least_share, average
        self._scores: list[Scores] = []
        self._log_density = np.zeros(num_tracks)  # of the tracks under the posterior before

    @property
    def effective_size(self) -> float:
        """Number of evenly weighted samples that would be as good."""
        return _effective_size(self.log_weights)

    def update(self, scores: Scores, posterior: TrackPosterior) -> Array:
        """Take in a view, with the posterior of the track up to and with it; returns (C,) log class posterior."""
        if self._scores:
            self._reweigh(posterior)
            if self.effective_size < self._least_share * len(self.log_weights):
                self._replace(posterior)
        newest = posterior.extend(self.tracks_m, self._generator)
        self.tracks_m = np.concatenate([self.tracks_m, newest[:, None]], axis=1)
        self._log_density = posterior.log_density(self.tracks_m)
        self.classifier.update(View(newest, scores))
        self._scores.append(scores)
        return self.log_posterior

    @property
    def log_posterior(self) -> Array:
        """(C,) average over the tracks."""
        weights = self.log_weights
        if self._average == "evidence":
            weights = normalised(weights + self.classifier.log_evidence)
        return averaged(self.classifier.log_posteriors, weights)

    def _reweigh(self, posterior: TrackPosterior) -> None:
        self.log_weights = normalised(self.log_weights + posterior.log_density(self.tracks_m) - self._log_density)

    def _replace(self, posterior: TrackPosterior) -> None:
        replacement = rejection_control(self.log_weights, self._generator)
        rows = np.flatnonzero(replacement.fresh)
        tracks = posterior.sample(len(rows), self._generator)[:, : self.tracks_m.shape[1]]
        self.classifier.replace(rows, replayed(self.classifier, self._scores, tracks))
        self.tracks_m[rows] = tracks
        self.log_weights = replacement.log_weights
        self.replaced += len(rows)


def replayed(classifier: SequentialClassifier, scores: Sequence[Scores], tracks_m: Array) -> SequentialClassifier:
    """A classifier of the same settings that has gone through the measurements along (P, k, 2) tracks."""
    fresh = classifier.empty(len(tracks_m))
    for k, measurement in enumerate(scores):
        fresh.update(View(tracks_m[:, k], measurement))
    return fresh


def rejection_control(log_weights: Array, generator: np.random.Generator) -> Replacement:
    """Keep samples with a chance of their weight over the mean one, at no less than the mean weight.

    That leaves the kept ones properly weighted. Fresh samples of the target share the rest evenly; kept and fresh ones
    count as two estimates of the same average, by their effective sizes.
    """
    count = len(log_weights)
    weights = np.exp(log_weights) * count  # mean 1
    kept = generator.random(count) < weights
    lifted = np.log(np.maximum(weights, 1.0))
    fresh = count - int(kept.sum())
    size = _effective_size(normalised(lifted[kept])) if kept.any() else 0.0
    renewed = np.full(count, -np.log(size + fresh))
    if kept.any():
        renewed[kept] = normalised(lifted[kept]) + np.log(size / (size + fresh))
    return Replacement(~kept, renewed)


def _effective_size(log_weights: Array) -> float:
    return float(np.exp(-log_sum_exp(2.0 * log_weights)))
