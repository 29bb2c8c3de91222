"""How an object's vectors change with the direction of view, from the beliefs of runs.

The views of each object are a Gaussian process over the direction (:mod:`semantic_slam.viewpoint.embeddings.model`):
how far it reaches, how different sides and views of one object usually are, and how many views tell nothing, follow
from the evidence of all views, weighed by the probability that they are of one object (type-II maximum likelihood).
Every run is held out in turn, under what the others tell; of a single run every stretch, under what its others tell.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce

import numpy as np

from semantic_slam.class_models.embedding import embedding_model
from semantic_slam.errors import InputError
from semantic_slam.training.embeddings.looks import STRETCHES, RunLooks
from semantic_slam.training.embeddings.replay import Replay, Usual, judged, rows_of
from semantic_slam.training.embeddings.report import report_of
from semantic_slam.training.judgement import Judgement
from semantic_slam.training.runs import Run
from semantic_slam.viewpoint.embeddings.model import SHARED_COUNTS, EmbeddingModel
from semantic_slam.viewpoint.embeddings.store import FittedEmbeddings, LooksByDirection

REPEAT_RADS = (0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0)
OUTLIER_SHARES = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2)
Part = tuple[int, int | None]
"""Number of a run, and a stretch of it, None for the whole run: what is held out."""
Point = tuple[int, int]
"""Places of a reach and of an outlier share among those that are tried."""


@dataclass(frozen=True, kw_only=True)
class Told:
    """What B runs tell of the model."""

    model: EmbeddingModel  # before any fit
    runs: Sequence[RunLooks]  # B
    known: dict[tuple[Part, Point], tuple[float, Usual]] = field(default_factory=dict)  # cache of ``evidence``

    @property
    def has_views(self) -> bool:
        """Whether any object has a vector."""
        return any(own.tracks for own in self.runs)

    @cached_property
    def rads(self) -> list[float]:
        """Reaches that are tried."""
        return sorted({*REPEAT_RADS, self.model.repeat_rad})

    @cached_property
    def shares(self) -> list[float]:
        """Outlier shares that are tried."""
        return sorted({*OUTLIER_SHARES, self.model.outlier_share})

    @cached_property
    def parts(self) -> list[Part]:
        """What is held out, one after the other."""
        if len(self.runs) > 1:
            return [(number, None) for number in range(len(self.runs))]
        return [(0, stretch) for stretch in range(STRETCHES)]

    @cached_property
    def before(self) -> Judgement:
        """Every part under the model as configured."""
        return _joined([judged(self.runs[run], self.model, stretch) for run, stretch in self.parts])

    @cached_property
    def after(self) -> Judgement:
        """Every part under what the others tell."""
        return _joined(
            [
                judged(self.runs[run], self.learned((run, stretch)).of(self.model), stretch)
                for run, stretch in self.parts
            ]
        )

    def learned(self, without: Part | None = None) -> LooksByDirection:
        """The likeliest parameters by all runs, or without a part of them; from nothing, those before any fit."""
        kept = [own for own in [_remaining(run, without) for run in range(len(self.runs))] if own is not None]
        best = self._climbed(kept) if kept else self._begin
        rad, share = self.rads[best[0]], self.shares[best[1]]
        counts = np.full(len(self.model.within), SHARED_COUNTS / len(self.model.within))
        if kept:
            usual = [self._evidence(part, best)[1] for part in kept]
            logs = np.concatenate([own.log_likelihoods for own in usual])
            counts = Usual(log_likelihoods=logs, weights=np.concatenate([own.weights for own in usual])).counts(counts)
        return LooksByDirection(repeat_rad=rad, counts=tuple(counts.tolist()), outlier_share=share)

    @property
    def _begin(self) -> Point:
        """The configured parameters."""
        return self.rads.index(self.model.repeat_rad), self.shares.index(self.model.outlier_share)

    def _climbed(self, parts: Sequence[Part]) -> Point:
        """The point from which no neighbour has more evidence, uphill from the configured one."""
        best = self._begin
        while True:
            rad, share = best
            near = [(rad + 1, share), (rad - 1, share), (rad, share + 1), (rad, share - 1)]
            inside = [own for own in near if 0 <= own[0] < len(self.rads) and 0 <= own[1] < len(self.shares)]
            found = max([best, *inside], key=lambda own: sum(self._evidence(part, own)[0] for part in parts))
            if found == best:
                return best
            best = found

    def _evidence(self, part: Part, point: Point) -> tuple[float, Usual]:
        """Log evidence of the views of a run outside a stretch, and what they tell of settings."""
        if (part, point) not in self.known:
            (run, stretch), (rad, share) = part, point
            model = replace(self.model, repeat_rad=self.rads[rad], outlier_share=self.shares[share])
            replay = Replay(self.runs[run], model)
            self.known[part, point] = replay.see(rows_of(self.runs[run], stretch)[0]), replay.usual
        return self.known[part, point]


def _remaining(run: int, without: Part | None) -> Part | None:
    """What is left of a run without a part of it, as the stretch that is not; None where nothing is."""
    if without is None or without[0] != run:
        return run, None
    return None if without[1] is None else without


def _joined(parts: Sequence[Judgement]) -> Judgement:
    """One judgement of several parts; objects of different parts count as different ones."""
    return reduce(_with, parts)


def _with(first: Judgement, second: Judgement) -> Judgement:
    beyond = first.objects.max(initial=-1) + 1
    return Judgement(
        log_evidence=first.log_evidence + second.log_evidence,
        probabilities=np.concatenate([first.probabilities, second.probabilities]),
        answers=np.concatenate([first.answers, second.answers]),
        objects=np.concatenate([first.objects, second.objects + beyond]),
    )


def looks_of(runs: Sequence[Run]) -> Told:
    """What runs tell. Raises InputError where vectors of several networks are mixed."""
    model = embedding_model(runs[0].settings)
    told = Told(model=model, runs=[RunLooks.of(run, model.dimensions) for run in runs])
    sizes = frozenset[int]().union(*(own.sizes for own in told.runs))
    if len(sizes) > 1:
        raise InputError(f"embeddings of {sorted(sizes)} components are mixed; give runs of one network alone")
    return told


def learn_embeddings(told: Told, digests: Sequence[str]) -> FittedEmbeddings:
    """What held-out views prefer, from runs of bags with these digests; nothing where there is too little.

    Raises InputError without any view.
    """
    if not told.has_views:
        raise InputError("no run has an object with a vector; let the detector send embeddings (DetectionArray)")
    is_kept = told.after.is_better_than(told.before)
    whole = told.learned() if is_kept else None
    model = told.model
    return FittedEmbeddings(
        dimensions=model.dimensions,
        spread_shares=model.spread_shares,
        noise_shares=model.noise_shares,
        whole=whole,
        without={own: told.learned((run, None)) for run, own in enumerate(digests) if is_kept and own},
        report=report_of(told.model, told.runs, whole, told.before, told.after),
    )
