"""Learning of a detector's label model from runs: candidates, held-out evaluation, and the model handed on."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from typing import Any, Self

import numpy as np

from semantic_slam.class_models.detector import load_label_model
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.training.detection.looks import looks_of
from semantic_slam.training.detection.rates import LearnedRates, learned
from semantic_slam.training.labels.candidates import alike, by_score, by_side
from semantic_slam.training.labels.expectation import Expectation
from semantic_slam.training.labels.fit import Fitted, as_they_are, with_known_classes
from semantic_slam.training.labels.judgement import judged
from semantic_slam.training.labels.maximisation import BeforeFit, class_shares, habit_shares
from semantic_slam.training.labels.passes import FOLDS, NO_STRETCH, STRETCHES, passed
from semantic_slam.training.labels.report import report_of
from semantic_slam.training.labels.tracks import Track, tracks_of
from semantic_slam.training.runs import Run
from semantic_slam.training.sightings import stretch_edges
from semantic_slam.viewpoint.labels.confusion import Confusion
from semantic_slam.viewpoint.labels.store import FittedBag, FittedLabels

LEAST_SHARE = 1e-3
"""Settings with less than this share of the likeliest one's weight are not handed on."""
LEAST_WORDS = 3.0
"""Words drawn from what a class is called, from which on its sides are told apart."""


@dataclass(frozen=True, kw_only=True)
class RunTracks:
    """What B runs of one detector tell, each by itself."""

    settings: SemanticModelConfiguration  # before any fit, with the labels of all
    runs: Sequence[Run]  # B
    edges: Sequence[tuple[int, ...]]  # B, where the stretches of each begin, and where the last one ends
    tracks: Sequence[Sequence[Track]]  # B

    @classmethod
    def of(cls, runs: Sequence[Run]) -> Self:
        """From the beliefs of runs. Raises InputError where not one object was seen."""
        labels = tuple(sorted({label for run in runs for label in run.settings.labels}))
        edges = [stretch_edges(run, STRETCHES) for run in runs]
        tracks = [tracks_of(run, labels, own) for run, own in zip(runs, edges, strict=True)]
        if not any(tracks):
            raise InputError("no run has an object that was seen; drive by objects that the detector reports")
        return cls(settings=replace(runs[0].settings, labels=labels), runs=runs, edges=edges, tracks=tracks)

    @property
    def every(self) -> list[Track]:
        """The tracks of all runs."""
        return [track for own in self.tracks for track in own]

    @cached_property
    def detection(self) -> LearnedRates:
        """How often the detector detects, against what the first run in the plane was told of that."""
        planar = [run for run in self.runs if not run.configuration.is_spatial]
        settings = (planar or self.runs)[0].configuration.open_world
        return learned([looks_of(run.record, run.configuration) for run in self.runs], settings, STRETCHES)

    @property
    def num_in_space(self) -> int:
        """Number of runs in space, of which no detection rates are learned."""
        return sum(run.configuration.is_spatial for run in self.runs)

    def bags(self, without: Sequence[tuple[Array, Array, Array]]) -> tuple[FittedBag, ...]:
        """Each with log weights of settings and shares of classes and habits that the others tell, and their rates."""
        return tuple(
            FittedBag(
                path=run.bag,
                sha256=run.sha256,
                stretch_edges_ns=edges,
                log_settings=tuple(log_settings.tolist()),
                class_shares=tuple(shares.tolist()),
                habits=tuple(habits.tolist()),
                detection=detection,
            )
            for run, edges, (log_settings, shares, habits), detection in zip(
                self.runs, self.edges, without, self.detection.without, strict=True
            )
        )


def learn(told: RunTracks) -> FittedLabels:
    """The models that held-out stretches prefer; those before any fit where there is too little to learn from."""
    settings = told.settings
    start = load_label_model(settings)
    assert start is not None
    before = BeforeFit(
        num_labels=len(settings.labels),
        accuracy=settings.label_accuracy,
        counts=settings.label_counts,
        outlier_share=settings.outlier_share,
    )
    unfitted = as_they_are([start] * len(FOLDS), told.every)
    same = alike(start, before, told.every)
    scored = max(same, by_score(same, before, told.every), key=_held_out)
    found = max(scored, by_side(scored, before, told.every), key=_held_out)
    as_run = with_known_classes(unfitted, told.every, settings.class_counts)
    first, last = judged(as_run, told.every), judged(found, told.every)
    is_better = last.is_better_than(first)
    detection = told.detection.numbers | {"runs": len(told.runs), "runs_in_space": told.num_in_space}
    report = report_of(found, is_better, first, last) | {"detection": detection}
    return _handed_on(found, told, report) if is_better else _as_before(unfitted, told, report)


def _held_out(own: Fitted) -> float:
    return own.held_out


def _handed_on(found: Fitted, told: RunTracks, report: dict[str, Any]) -> FittedLabels:
    """With the settings that are left, and what bags tell of settings and classes without one of them."""
    whole = found.whole
    kept = np.flatnonzero(whole.weights >= LEAST_SHARE * whole.weights.max())
    model = replace(whole.model, settings=whole.model.settings.take(kept))
    own = [passed(model, tracks, NO_STRETCH).told for tracks in told.tracks]

    def of(runs: Sequence[Expectation]) -> tuple[Array, Array, Array]:
        """(R,) log weights of settings, (C,) shares of classes and (H,) of habits."""
        told = reduce(lambda one, other: one.plus(other, 1.0), runs, Expectation.nothing(model))
        settings = model.settings.weighted(model.settings.log_weights + told.log_evidence).log_weights
        weights = np.exp(settings)
        return settings, class_shares(weights @ told.classes), habit_shares(weights @ told.habits)

    log_settings, shares, habits = of(own)
    words = np.tensordot(whole.weights, whole.told.drawn, axes=1).sum(axis=(0, 2))  # (L,)
    without = [of([*own[:number], *own[number + 1 :]]) for number in range(len(own))]
    return FittedLabels(
        labels=model.labels,
        settings=model.settings.weighted(log_settings),
        confusions=tuple(_lean(own.model.confusions[-1], words >= LEAST_WORDS) for own in found.passes),
        class_shares=shares,
        habits=habits,
        bags=told.bags(without),
        report=report,
        detection=told.detection.values,
    )


def _lean(confusion: Confusion, is_known: Flags) -> Confusion:
    """With all sides alike of classes that are not known (L,): of these no run has to sum over headings."""
    even = confusion.counts.mean(axis=0, keepdims=True)
    return replace(confusion, counts=np.where(is_known[:, None], confusion.counts, even))


def _as_before(unfitted: Fitted, told: RunTracks, report: dict[str, Any]) -> FittedLabels:
    model = unfitted.whole.model
    return FittedLabels(
        labels=model.labels,
        settings=model.settings,
        confusions=tuple(own.model.confusions[-1] for own in unfitted.passes),
        class_shares=model.class_shares,
        bags=told.bags([(model.settings.log_weights, model.class_shares, model.habits)] * len(told.runs)),
        report=report,
        detection=told.detection.values,
    )
