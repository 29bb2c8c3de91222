"""Semantics of correlated views, without factors: evidence averaged over samples of the track (Sec. 3.3.4).

Track samples come from the geometric posterior. Each has the unnormalised p(z_1:k | track, c). The average over samples
is the evidence in the hypothesis's weight; a sample's share of the sum is its importance weight when classes and poses
are reported. Every object's evidence is computed by itself, so the tracks relative to two objects count as independent.
"""

from collections import defaultdict
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.optimize import brentq

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.log_space import log_sum_exp
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.semantics.independent_views import score_offsets
from semantic_slam.inference.semantics.interface import ClassModels, SemanticEvidence, SemanticInput, at_hand
from semantic_slam.inference.semantics.track_samples import SampledRow, sample_rows
from semantic_slam.inference.states.correction import Correction
from semantic_slam.inference.states.object_views import ObjectViews, class_posterior, coverage_of
from semantic_slam.perception.uncertainty import mutual_information
from semantic_slam.viewpoint.correlated import CorrelatedModel, Evidence
from semantic_slam.viewpoint.gaussian_process import GaussianProcessModel
from semantic_slam.viewpoint.model import Viewpoints

LEAST_EFFECTIVE_SHARE = 0.2
"""Least share of effective tracks from which moments are taken: fewer would feign precision."""


@dataclass(frozen=True, kw_only=True)
class RecordedView:
    """One semantic measurement of an object."""

    keyframe: int
    sensor: Array  # (2,) camera in the body frame
    feature: Array  # (F,)
    variance: Array  # (F,) of the dropout samples


@dataclass(frozen=True, kw_only=True)
class TrackedViews:
    """One object in one continuation: its views within the window, newest last, along P sampled tracks."""

    row: int
    place: int  # index of the object in the input's list
    before: ObjectViews | None
    views: tuple[RecordedView, ...]  # V
    azimuth_rad: Array  # (P, V)
    detection: PlanarDetection  # the newest
    flag: bool  # whether the newest view is inside the models' coverage


class CorrelatedViews:
    """Weighs continuations by the evidence of their objects' views."""

    def __init__(self, model: CorrelatedModel, num_tracks: int, window: int, average: str, seed: int) -> None:
        """``window`` W: number of views that a new one correlates with; ``average``: of evidence, or as in Eq. 3.20."""
        self._model, self._num_tracks, self._window, self._seed = model, num_tracks, window, seed
        self._thesis = average == "thesis"

    @classmethod
    def of(cls, models: ClassModels) -> Self:
        """From the configured Gaussian process models, which the kind of class models must have."""
        assert isinstance(models.viewpoint, GaussianProcessModel)
        settings, seed = models.configuration.semantic_model, models.configuration.seed
        correlated = CorrelatedModel(models.viewpoint, settings.sigma_view)
        return cls(correlated, settings.num_tracks, settings.window, settings.track_average, seed)

    def weigh(self, given: SemanticInput) -> SemanticEvidence:
        """Evidence and records of K continuations."""
        rows = sample_rows(given, self._num_tracks, self._seed)
        log_weights = np.zeros(len(rows))
        views: list[dict[int, ObjectViews]] = [{} for _ in rows]
        by_track: list[dict[int, Array]] = [{} for _ in rows]
        for number in range(len(given.used)):
            sightings = self._tracked(given, rows, views, number)
            for tracked, evidence in self._evidence(sightings):
                prior = given.log_class_prior[tracked.place]
                object_id = given.object_ids[tracked.place]
                record, tracks = self._record(tracked, evidence, prior)
                log_weights[tracked.row] += _log_evidence(prior, record) - _log_evidence(prior, tracked.before)
                views[tracked.row][object_id], by_track[tracked.row][object_id] = record, tracks
        if self._thesis:
            effective = np.full(len(rows), float(self._num_tracks))
            return replace(SemanticEvidence.of(log_weights, views), effective_sample_sizes=effective)
        return _with_corrections(given, rows, log_weights, by_track, views)

    def _tracked(
        self, given: SemanticInput, rows: list[SampledRow], views: list[dict[int, ObjectViews]], number: int
    ) -> list[TrackedViews]:
        stack, index = given.stack, given.used[number]
        detection = given.step.detections[index]
        variance = np.diag(detection.feature_covariance)
        seen = RecordedView(
            keyframe=given.step.index, sensor=detection.sensor, feature=detection.feature, variance=variance
        )
        sightings = []
        for row in np.flatnonzero(stack.active[:, number]):
            place = int(stack.rows.objects[row, number])
            object_id = given.object_ids[place]
            parent = given.parents[stack.rows.parents[row]]
            before = views[row].get(object_id, parent.views.get(object_id))
            together = (*(before.recent if before else ()), seen)
            o = rows[row].objects(stack.slots[row, number])
            azimuth = [self._azimuth(given, rows[row], view, o) for view in together]
            flag = bool(given.step.in_coverage[index])
            sightings.append(
                TrackedViews(
                    row=int(row),
                    place=place,
                    before=before,
                    views=together,
                    azimuth_rad=np.stack(azimuth, axis=1),
                    detection=detection,
                    flag=flag,
                )
            )
        return sightings

    def _azimuth(self, given: SemanticInput, row: SampledRow, view: RecordedView, o: Array) -> Array:
        now = view.keyframe == given.step.index
        x = row.robots if now else row.robot_at(view.keyframe)
        return row.spaces.viewpoints(x, o, view.sensor).azimuth_rad

    def _evidence(self, sightings: list[TrackedViews]) -> list[tuple[TrackedViews, Evidence]]:
        """Evidence of the sightings, batched by number of views."""
        by_length: dict[int, list[TrackedViews]] = defaultdict(list)
        for tracked in sightings:
            by_length[len(tracked.views)].append(tracked)
        found = []
        for group in by_length.values():
            evidence = self._of_views(group, slice(None))
            for at, tracked in enumerate(group):
                rows = slice(at * self._num_tracks, (at + 1) * self._num_tracks)
                found.append((tracked, evidence.rows(rows)))
        return found

    def _of_views(self, sightings: list[TrackedViews], selection: slice) -> Evidence:
        azimuth = np.concatenate([tracked.azimuth_rad[:, selection] for tracked in sightings])
        stacked = [
            np.array([[getattr(view, name) for view in tracked.views[selection]] for tracked in sightings])
            for name in ("feature", "variance")
        ]
        return self._model.evidence(azimuth, *(np.repeat(value, self._num_tracks, axis=0) for value in stacked))

    def _record(self, tracked: TrackedViews, evidence: Evidence, log_prior: Array) -> tuple[ObjectViews, Array]:
        """The object's record with its newest view, and (P,) log likelihood of the views along each track."""
        before = tracked.before
        base = np.zeros(len(log_prior)) if before is None or before.log_dropped is None else before.log_dropped
        by_track = base + evidence.log_likelihood  # (P, C)
        dropped, recent, log_dropped = (before.dropped if before else 0), tracked.views, base
        if len(recent) > self._window:
            recent, dropped = recent[1:], dropped + 1
            kept = self._of_views([tracked], slice(1, None)).log_likelihood
            log_dropped = base + _mean(evidence.log_likelihood) - _mean(kept)
        likelihood = self._averaged(by_track, log_prior)
        best = int(np.argmax(log_prior + likelihood))
        azimuth = np.asarray(tracked.azimuth_rad[:, -1])
        nearby = Viewpoints(azimuth, np.zeros_like(azimuth), np.ones_like(azimuth))
        covered = self._model.independent.in_coverage(np.full(len(azimuth), best), nearby).mean() >= 0.5
        record = ObjectViews(
            log_likelihood=likelihood,
            mutual_information=self._epistemic(base, tracked, evidence, log_prior),
            coverage=coverage_of(before).with_view(
                float(np.angle(np.exp(1j * azimuth).mean())), is_recognised=tracked.flag, is_fitted=bool(covered)
            ),
            newest=likelihood - self._averaged(by_track - evidence.newest, log_prior),
            recent=recent,
            log_dropped=log_dropped,
            dropped=dropped,
        )
        return record, log_sum_exp(log_prior + by_track)

    def _averaged(self, by_track: Array, log_prior: Array) -> Array:
        """(C,) log likelihood from (P, C) by track; with Eq. 3.20 posteriors are averaged with equal weights."""
        average = _mean(by_track)
        if not self._thesis:
            return average
        joint = log_prior + by_track
        posterior = _mean(joint - log_sum_exp(joint, keepdims=True))
        with np.errstate(invalid="ignore"):
            ratio = np.where(np.isfinite(log_prior), posterior - log_prior, 0.0)
        return np.asarray(ratio + log_sum_exp(log_prior + average))

    def _epistemic(self, base: Array, tracked: TrackedViews, evidence: Evidence, log_prior: Array) -> float:
        """Spread of the posterior over draws of the newest measurement from the network's uncertainty (Eq. 3.25)."""
        earlier = base + evidence.log_likelihood - evidence.newest  # (P, C)
        drawn = _mean(earlier[..., None] + evidence.of_newest(score_offsets(tracked.detection)))  # (C, M)
        return float(mutual_information(class_posterior(log_prior, drawn.T)))


def _with_corrections(
    given: SemanticInput,
    rows: list[SampledRow],
    log_weights: Array,
    by_track: list[dict[int, Array]],
    views: list[dict[int, ObjectViews]],
) -> SemanticEvidence:
    """Evidence with corrections of the robot's and objects' poses by the weights of the tracks."""
    effective, layout = np.full(len(rows), np.nan), given.stack.layout
    robot: list[Correction | None] = [None] * len(rows)
    for row, sampled in enumerate(rows):
        if not views[row]:
            continue
        together = np.sum(list(by_track[row].values()), axis=0)
        shares = _shares(together)
        effective[row] = _effective_size(shares)
        shares = _flattened(together, LEAST_EFFECTIVE_SHARE * len(together))
        robot[row] = Correction.of_samples(sampled.deviations[:, 0, : layout.robot], shares)
        for number in np.flatnonzero(given.stack.active[row]):
            object_id = given.object_ids[given.stack.rows.objects[row, number]]
            deviations = sampled.deviations[:, 1 + given.stack.slots[row, number], : layout.landmark]
            views[row][object_id] = replace(views[row][object_id], correction=Correction.of_samples(deviations, shares))
    return SemanticEvidence(
        log_weights=log_weights, effective_sample_sizes=effective, records=at_hand(views), robot=robot
    )


def _shares(log_weights: Array) -> Array:
    return np.asarray(np.exp(log_weights - log_sum_exp(log_weights)))


def _effective_size(shares: Array) -> float:
    return float(1.0 / (shares**2).sum())


def _flattened(log_weights: Array, least_size: float) -> Array:
    """Normalised weights raised to the largest power up to 1 that leaves ``least_size`` effective samples."""
    if _effective_size(_shares(log_weights)) >= least_size:
        return _shares(log_weights)
    return _shares(log_weights * brentq(lambda power: _effective_size(_shares(power * log_weights)) - least_size, 0, 1))


def _log_evidence(log_prior: Array, views: ObjectViews | None) -> float:
    """log p(z_1:k) of an object's semantic measurements; 0 before the first."""
    return 0.0 if views is None else float(log_sum_exp(log_prior + views.log_likelihood))


def _mean(by_track: Array) -> Array:
    """Log of the average over (P, ...) tracks."""
    return np.asarray(log_sum_exp(by_track, axis=0) - np.log(len(by_track)))
