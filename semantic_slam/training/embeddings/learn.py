"""How an object's vectors change with the direction of view, from the best histories of runs.

The views of each object are a Gaussian process over the direction (:mod:`embedding_model`): how far it reaches, and how
different the sides of objects usually are, is told by the evidence of all views, in their order. Every run is held out
in turn, under what the others tell, and judges whether that is better than what is expected of any network.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from semantic_slam.answers.appearances import SeenView, seen_views
from semantic_slam.class_models.embedding import embedding_model
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.training.labels.runs import Run
from semantic_slam.viewpoint.embeddings.background import EmbeddingBackground, SeenVectors
from semantic_slam.viewpoint.embeddings.model import SHARED_COUNTS, EmbeddingModel, EmbeddingRecord
from semantic_slam.viewpoint.embeddings.store import FittedEmbeddings, LooksByDirection
from semantic_slam.viewpoint.embeddings.vectors import reduced

REPEAT_RADS = (0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0)
LEAST_GAIN = 3.0
"""Nats by which held-out log evidence has to be better than before any fit."""


@dataclass(frozen=True, kw_only=True)
class RunLooks:
    """The vectors of one run."""

    views: Sequence[SeenView]  # of its objects, in the order of the drive; reduced
    background: EmbeddingBackground
    sizes: frozenset[int]  # components of the vectors as they were sent

    @classmethod
    def of(cls, run: Run, dimensions: int) -> Self:
        """As the best history of a run associates them."""
        views, others = seen_views(run.record.beliefs, run.record.measurements)
        own = [replace(view, vector=reduced(view.vector[None], dimensions)[0]) for view in views]
        every = [*(view.vector for view in own), *(reduced(vector[None], dimensions)[0] for vector in others)]
        seen = SeenVectors.none(dimensions).with_vectors(np.array(every).reshape(-1, dimensions))
        sizes = frozenset(len(vector) for vector in (*(view.vector for view in views), *others))
        return cls(views=own, background=seen.background, sizes=sizes)

    def told(self, model: EmbeddingModel) -> tuple[float, Array]:
        """Log evidence of all views, relative to the background, and (R,) objects that have each setting."""
        records, total = dict[int, EmbeddingRecord](), 0.0
        for view in self.views:
            record = records.get(view.object_id, model.start())
            others = [own.told_settings for number, own in sorted(records.items()) if number != view.object_id]
            usual = model.usual(np.sum([np.zeros(len(model.within)), *others], axis=0))
            ratio = record.log_ratios(view.vector, self.background, view.place)[:, 0]
            total += model.evidence(record, ratio, usual)
            records[view.object_id] = record.after(view.vector, ratio, usual, self.background, view.place)
        return total, np.sum([np.zeros(len(model.within)), *(own.told_settings for own in records.values())], axis=0)


@dataclass(frozen=True, kw_only=True)
class Told:
    """What B runs tell under each reach of the views."""

    model: EmbeddingModel  # before any fit
    runs: Sequence[RunLooks]  # B

    @cached_property
    def rads(self) -> Array:
        """(G,) reaches that are tried."""
        return np.unique([*REPEAT_RADS, self.model.repeat_rad])

    @cached_property
    def by_reach(self) -> tuple[Array, Array]:
        """(B, G) log evidence and (B, G, R) objects that have each setting."""
        found = [[run.told(replace(self.model, repeat_rad=float(own))) for own in self.rads] for run in self.runs]
        return np.array([[own[0] for own in row] for row in found]), np.array(
            [[own[1] for own in row] for row in found]
        )

    @property
    def before(self) -> float:
        """Log evidence as configured."""
        return float(self.by_reach[0][:, np.flatnonzero(self.rads == self.model.repeat_rad)[0]].sum())

    @cached_property
    def after(self) -> float:
        """Log evidence of every run under what the others tell."""
        others = [self.learned([n for n in range(len(self.runs)) if n != own]) for own in range(len(self.runs))]
        return sum(run.told(own.of(self.model))[0] for run, own in zip(self.runs, others, strict=True))

    def learned(self, numbers: Sequence[int]) -> LooksByDirection:
        """By some of the runs."""
        evidence, objects = self.by_reach
        best = int(np.argmax(evidence[list(numbers)].sum(axis=0)))
        counts = SHARED_COUNTS / objects.shape[2] + objects[list(numbers), best].sum(axis=0)
        return LooksByDirection(repeat_rad=float(self.rads[best]), counts=tuple(counts.tolist()))


def learn_embeddings(runs: Sequence[Run]) -> FittedEmbeddings:
    """What held-out runs prefer; nothing where there is too little to learn from. Raises InputError without vectors."""
    settings = replace(runs[0].configuration.semantic_model, path="", path_digest="")
    model = embedding_model(settings)
    told = Told(model=model, runs=[RunLooks.of(run, model.dimensions) for run in runs])
    num_views = sum(len(own.views) for own in told.runs)
    if not num_views:
        raise InputError("no run has an object with a vector; let the detector send embeddings (DetectionArray)")
    sizes = frozenset[int]().union(*(own.sizes for own in told.runs))
    if len(sizes) > 1:
        raise InputError(f"embeddings of {sorted(sizes)} components are mixed; give runs of one network alone")
    several = len(runs) > 1
    is_kept = several and told.after >= told.before + LEAST_GAIN
    whole = told.learned(range(len(runs))) if is_kept else None
    numbers = list(range(len(runs)))
    return FittedEmbeddings(
        dimensions=model.dimensions,
        spread_shares=model.spread_shares,
        noise_shares=model.noise_shares,
        whole=whole,
        without={
            run.sha256: told.learned([n for n in numbers if n != own])
            for own, run in enumerate(runs)
            if is_kept and run.sha256
        },
        report={
            "is_kept": is_kept,
            "views": num_views,
            "runs": len(runs),
            "log_evidence": {"before": told.before, "after": told.after if several else None},
            "repeat_rad": whole.repeat_rad if whole is not None else model.repeat_rad,
        },
    )


def lines_of(fitted: FittedEmbeddings) -> list[str]:
    """What was learned, in a line."""
    own = fitted.report
    if own["log_evidence"]["after"] is None:
        return ["one run alone cannot be judged by another, so the models are as before any fit; give two or more"]
    before, after = own["log_evidence"]["before"], own["log_evidence"]["after"]
    judged = f"held-out log evidence {before:.1f} -> {after:.1f} nats of {own['views']} vectors of {own['runs']} runs"
    if not own["is_kept"]:
        return [f"too little to learn from, so the models are as before any fit: {judged}"]
    return [f"an object's looks change over {own['repeat_rad']:g} rad of direction; {judged}"]
