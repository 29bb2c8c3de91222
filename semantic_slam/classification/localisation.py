"""Incremental classification under an uncertain track, with track samples that persist between views."""

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from semantic_slam.classification.classifier import Scores, SequentialClassifier, View, averaged, normalised
from semantic_slam.classification.resampling import effective_size, rejection_control, systematic_resampling
from semantic_slam.classification.track_posterior import TrackPosterior
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.log_space import log_sum_exp

LEAST_MOVE = 0.01
"""Smallest step of a move, as a share of the posterior's spread."""


class SampledTracks(ABC):
    """A classifier run on P samples of the track, each with its own class history (Eqs. 3.20, 3.42).

    The samples are extended view by view. Where a new posterior p' of the earlier track differs from the posterior p
    that the sample was drawn from, the sample's weight is multiplied by p' / p (importance sampling; the ratio in
    Sec. 3.3.4.2 is printed inverted). When the effective sample size falls below ``least_share`` of P, the samples are
    redrawn from the new posterior, for which the earlier views are replayed.
    """

    classifier: SequentialClassifier  # for all P tracks
    log_weights: Array  # (P,) normalised
    tracks_m: Array  # (P, k, 2) locations relative to the object
    _log_density: Array  # (P,) of the tracks under the previous posterior

    def __init__(
        self,
        classifier: SequentialClassifier,
        num_tracks: int,
        generator: np.random.Generator,
        *,
        least_share: float = 0.5,
    ) -> None:
        """``classifier`` provides the method and its settings; it is not modified."""
        self.replaced = 0  # number of tracks redrawn so far
        self._generator, self._least_size = generator, least_share * num_tracks
        self._scores: list[Scores] = []
        self._start(classifier, num_tracks)

    @property
    def effective_size(self) -> float:
        """Effective sample size of the weights."""
        return effective_size(self.log_weights)

    @property
    def log_posterior(self) -> Array:
        """(C,) log class posterior averaged over the tracks by their weights."""
        return averaged(self.classifier.log_posteriors, self.log_weights)

    def update(self, scores: Scores, posterior: TrackPosterior) -> Array:
        """Take in a view, with the posterior of the track up to and with it; returns (C,) log class posterior."""
        if self._scores:
            self._weigh(posterior.log_density(self.tracks_m) - self._log_density)
            if self.effective_size < self._least_size:
                self._renew(posterior)
        self._advance(scores, posterior)
        self._scores.append(scores)
        self._log_density = posterior.log_density(self.tracks_m)
        return self.log_posterior

    def _start(self, classifier: SequentialClassifier, num_tracks: int) -> None:
        self.classifier = classifier.empty(num_tracks)
        self.log_weights = np.full(num_tracks, -np.log(num_tracks))
        self.tracks_m = np.empty((num_tracks, 0, 2))
        self._log_density = np.zeros(num_tracks)

    def _advance(self, scores: Scores, posterior: TrackPosterior) -> None:
        newest = posterior.extend(self.tracks_m, self._generator)
        self.tracks_m = np.concatenate([self.tracks_m, newest[:, None]], axis=1)
        self.classifier.update(View(newest, scores))

    def _weigh(self, log_factors: Array) -> None:
        """Multiply the weights by (P,) factors."""
        self.log_weights = normalised(self.log_weights + log_factors)

    @abstractmethod
    def _renew(self, posterior: TrackPosterior) -> None:
        """Resample the tracks from the posterior, up to the view before its newest."""


class GeometricTracks(SampledTracks):
    """Eq. 3.20 as in the thesis: normalised posteriors, averaged over the geometric belief alone."""

    def _renew(self, posterior: TrackPosterior) -> None:
        """Replace low-weight samples by fresh tracks; the others keep their history."""
        fresh, self.log_weights = rejection_control(self.log_weights, self._generator)
        tracks = posterior.sample(len(fresh), self._generator)[:, : self.tracks_m.shape[1]]
        self.classifier.replace(fresh, replayed(self.classifier, self._scores, tracks), np.arange(len(fresh)))
        self.tracks_m[fresh] = tracks
        self.replaced += len(fresh)


class EvidenceTracks(SampledTracks):
    """Joint posterior of track and class: tracks are also weighted by how well they explain the scores.

    A particle filter whose particles carry class histories; light ones are replaced by copies of heavy ones.
    ``log_evidence`` is log p(z_0:k) over track and class, unbiased before the logarithm. With ``move`` the copies are
    moved immediately (resample-move: a Metropolis step to a nearby track, accepted by the evidence, for which the views
    are replayed). This is needed where copies would not diverge on their own, as with one offset for the whole track.
    """

    log_evidence: float
    moved = 0  # number of accepted track moves so far

    def __init__(
        self,
        classifier: SequentialClassifier,
        num_tracks: int,
        generator: np.random.Generator,
        *,
        least_share: float = 0.5,
        move: bool = False,
    ) -> None:
        super().__init__(classifier, num_tracks, generator, least_share=least_share)
        self._moves = move

    def _start(self, classifier: SequentialClassifier, num_tracks: int) -> None:
        super()._start(classifier, num_tracks)
        self.log_evidence = 0.0

    def _advance(self, scores: Scores, posterior: TrackPosterior) -> None:
        before = self.classifier.log_evidence
        super()._advance(scores, posterior)
        self._weigh(self.classifier.log_evidence - before)
        if self.effective_size < self._least_size:
            lost, copied = systematic_resampling(self.log_weights, self._generator)
            self.classifier.replace(lost, self.classifier, copied)
            self.tracks_m[lost] = self.tracks_m[copied]
            self.log_weights = np.full_like(self.log_weights, -np.log(len(self.log_weights)))
            if self._moves:
                self._move([*self._scores[: self.tracks_m.shape[1] - 1], scores], posterior)

    def _weigh(self, log_factors: Array) -> None:
        """Multiply the weights by (P,) factors, and the evidence by their weighted mean.

        This is so for the likelihood of a view and for p' / p of a new posterior alike: the samples stand for p times
        the likelihood over the evidence, and p' times the likelihood integrates to the evidence times that mean.
        """
        self.log_evidence += float(log_sum_exp(self.log_weights + log_factors))
        super()._weigh(log_factors)

    def _move(self, scores: Sequence[Scores], posterior: TrackPosterior) -> None:
        """One Metropolis step of every track; the target is the posterior of the track times its evidence."""
        count = len(self.tracks_m)
        share = np.exp(self._generator.uniform(np.log(LEAST_MOVE), 0.0, count))
        tracks = posterior.move(self.tracks_m, share, self._generator)
        moved = replayed(self.classifier, scores, tracks)
        gain = moved.log_evidence - self.classifier.log_evidence
        taken = np.flatnonzero(np.log(self._generator.random(count)) < gain)
        self.classifier.replace(taken, moved, taken)
        self.tracks_m[taken] = tracks[taken]
        self.moved += len(taken)

    def _renew(self, posterior: TrackPosterior) -> None:
        """Redraw all tracks and replay the views: which tracks explain the scores depends on the posterior."""
        self.replaced += len(self.log_weights)
        self._start(self.classifier, len(self.log_weights))
        for scores in self._scores:
            self._advance(scores, posterior)


class EvidencePerClass:
    """Class posterior p(c | z_0:k) from evidences p(z_0:k | c), each with its own tracks conditioned on the class."""

    def __init__(self, of_classes: Sequence[EvidenceTracks], log_prior: Array) -> None:
        """``of_classes`` (C,): sampled tracks whose classifiers know one class each."""
        self.of_classes = tuple(of_classes)
        self._log_prior = log_prior

    @property
    def log_posterior(self) -> Array:
        """(C,) log class posterior from each class's own evidence, in nats."""
        return normalised(self._log_prior + np.array([tracks.log_evidence for tracks in self.of_classes]))

    def update(self, scores: Scores, posterior: TrackPosterior) -> Array:
        """Take in a view, with the posterior of the track up to and with it; returns (C,) log class posterior."""
        for tracks in self.of_classes:
            tracks.update(scores, posterior)
        return self.log_posterior


def replayed(classifier: SequentialClassifier, scores: Sequence[Scores], tracks_m: Array) -> SequentialClassifier:
    """New classifier with these settings, after replaying the measurements along (P, k, 2) tracks."""
    fresh = classifier.empty(len(tracks_m))
    for k, measurement in enumerate(scores):
        fresh.update(View(tracks_m[:, k], measurement))
    return fresh
