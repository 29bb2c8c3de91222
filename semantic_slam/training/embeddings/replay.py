"""The views of a run's objects under one embedding model, one after the other, as a run takes them."""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.log_space import finite_log_sum_exp
from semantic_slam.training.embeddings.looks import LookTrack, LookView, RunLooks
from semantic_slam.training.judgement import Judgement
from semantic_slam.viewpoint.embeddings.model import EmbeddingModel

Row = tuple[int, LookView]
"""Number of a track, and a view of it."""
LEAST_WEIGHT = 0.5
"""Tracks that are less likely are not judged."""


@dataclass(frozen=True, kw_only=True)
class Usual:
    """What T tracks tell of the R settings (spreads) that objects have."""

    log_likelihoods: Array  # (T, R) of each setting; those of one view tell nothing
    weights: Array  # (T,)

    def counts(self, prior: Array, rounds: int = 200) -> Array:
        """(R,) objects expected to have each setting, after (R,) pseudo-counts, at their most likely shares (EM)."""
        counts = prior
        for _ in range(rounds):
            logs = self.log_likelihoods + np.log(counts / counts.sum())
            posteriors = np.exp(logs - finite_log_sum_exp(logs)[:, None])
            before, counts = counts, prior + self.weights @ posteriors
            if np.abs(counts - before).max() < 1e-6:
                break
        return np.asarray(counts)


class Replay:
    """Records of all tracks of a run; the frequencies of settings are learned on the way, as in a run."""

    def __init__(self, looks: RunLooks, model: EmbeddingModel) -> None:
        self.looks, self._model = looks, model
        self._records = [model.start() for _ in looks.tracks]
        self._told = np.zeros(len(model.within))  # (R,) weighted sum over all tracks
        self._of_object: defaultdict[int, Array] = defaultdict(lambda: np.zeros(len(model.within)))

    def see(self, rows: Iterable[Row]) -> float:
        """Take up views in this order; their log evidence relative to the background, weighted by their tracks."""
        return sum(self.looks.tracks[number].weight * self._see(number, view) for number, view in rows)

    def _see(self, number: int, view: LookView) -> float:
        background, record, track = self.looks.background, self._records[number], self.looks.tracks[number]
        usual = self._usual(track)
        ratio = record.log_ratios(view.vector, background, view.place)[:, 0]
        self._records[number] = after = record.after(view.vector, ratio, usual, background, view.place)
        gained = track.weight * (after.told_settings - record.told_settings)
        self._told = self._told + gained
        self._of_object[track.object_id] = self._of_object[track.object_id] + gained
        return self._model.evidence(record, ratio, usual)

    def _usual(self, track: LookTrack) -> Array:
        """(R,) log probabilities of the settings for an object, by all others."""
        return self._model.usual(self._told - self._of_object[track.object_id])

    def probability_of_own(self, number: int, own: LookView, other: LookView) -> float:
        """Probability that of two views, one of an object and ``other``, the first is that object's.

        Both are taken to be from the place of the first.
        """
        background, record, usual = self.looks.background, self._records[number], self._usual(self._track(number))
        told = [
            self._model.evidence(record, record.log_ratios(view.vector, background, own.place)[:, 0], usual)
            for view in (own, other)
        ]
        return float(np.exp(told[0] - np.logaddexp(told[0], told[1])))

    def _track(self, number: int) -> LookTrack:
        return self.looks.tracks[number]

    @property
    def usual(self) -> Usual:
        """What the tracks with several views tell of settings."""
        numbers = [number for number, record in enumerate(self._records) if record.num_views > 1]
        logs = np.array([self._records[number].log_settings for number in numbers])
        return Usual(
            log_likelihoods=logs.reshape(len(numbers), len(self._model.within)),
            weights=np.array([self._track(number).weight for number in numbers]),
        )


def rows_of(looks: RunLooks, stretch: int | None) -> tuple[list[Row], list[Row]]:
    """Views outside a stretch, and those in it (None: no stretch), each in the order of the drive."""
    every = sorted(
        ((number, view) for number, track in enumerate(looks.tracks) for view in track.views),
        key=lambda row: (row[1].keyframe, row[1].detection, row[0]),
    )
    return [row for row in every if row[1].stretch != stretch], [row for row in every if row[1].stretch == stretch]


def judged(looks: RunLooks, model: EmbeddingModel, stretch: int | None) -> Judgement:
    """How well a model predicts a stretch of a run, given the rest of it; None: the whole run, given nothing.

    Answers are which of two views is an object's: its own next one, or that of another object in turn.
    """
    before, left = rows_of(looks, stretch)
    kept, wanted = ([], before) if stretch is None else (before, left)
    replay = Replay(looks, model)
    replay.see(kept)
    evidence, found = 0.0, list[tuple[float, int]]()
    seen = {number for number, _ in kept}
    for (number, view), other in zip(wanted, _others(looks, wanted), strict=True):
        if other is not None and number in seen and looks.tracks[number].weight >= LEAST_WEIGHT:
            found.append((replay.probability_of_own(number, view, other), number))
        evidence += replay.see([(number, view)])
        seen.add(number)
    return _judgement(evidence, found)


def _others(looks: RunLooks, rows: list[Row]) -> Iterator[LookView | None]:
    """For each view the latest one before it that is of another object; None where there is none."""
    latest: dict[int, LookView] = {}
    for number, view in rows:
        own = looks.tracks[number].object_id
        yield next((latest[key] for key in reversed(latest) if key != own), None)
        latest.pop(own, None)
        latest[own] = view


def _judgement(evidence: float, found: list[tuple[float, int]]) -> Judgement:
    """From the probabilities of objects' own views; which of the two answers that is alternates."""
    answers = np.arange(len(found)) % 2
    own = np.array([probability for probability, _ in found])
    first = np.where(answers == 0, own, 1.0 - own)
    return Judgement(
        log_evidence=evidence,
        probabilities=np.stack([first, 1.0 - first], axis=1),
        answers=answers,
        objects=np.array([number for _, number in found], dtype=int),
    )
