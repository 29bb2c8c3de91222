"""One pass over all tracks, with a stretch of the drives left out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.log_space import finite_log_sum_exp
from semantic_slam.training.labels.expectation import Expectation, Replayed, expected, replayed
from semantic_slam.training.labels.tracks import Track
from semantic_slam.viewpoint.labels.model import LabelModel
from semantic_slam.viewpoint.labels.record import LabelView

STRETCHES = 5
"""Parts of a drive, each of which is held out once."""
NO_STRETCH = -1
FOLDS = (*range(STRETCHES), NO_STRETCH)
"""What is left out of each of the models."""


@dataclass(frozen=True, kw_only=True)
class Pass:
    """All tracks under one model."""

    model: LabelModel
    told: Expectation  # by what is not left out
    log_evidence: Array  # (R,) with what is

    @property
    def weights(self) -> Array:
        """(R,) of the settings, by what is not left out."""
        logs = self.model.settings.log_weights + self.told.log_evidence
        return np.asarray(np.exp(logs - finite_log_sum_exp(logs)))

    @property
    def gain(self) -> float:
        """Log evidence of what is left out, given the rest, in nats."""
        logs = self.model.settings.log_weights
        with_it, without = (finite_log_sum_exp(logs + own) for own in (self.log_evidence, self.told.log_evidence))
        return float(with_it - without)


def passed(model: LabelModel, tracks: Sequence[Track], fold: int) -> Pass:
    """What tracks tell, with a stretch left out."""
    told = Expectation.nothing(model)
    log_evidence = np.zeros(model.num_settings)
    for track in tracks:
        kept, left = views_of(track, fold)
        own = replayed(model, track, kept)
        told = told.plus(expected(model, own, own.rows), track.weight)
        log_evidence += track.weight * with_views(model, own, left).log_evidence
    return Pass(model=model, told=told, log_evidence=log_evidence)


def views_of(track: Track, fold: int) -> tuple[list[LabelView], list[LabelView]]:
    """What a model is fitted to of a track, and what is left out of it."""
    kept = [view for view, stretch in zip(track.views, track.stretches, strict=True) if stretch != fold]
    left = [view for view, stretch in zip(track.views, track.stretches, strict=True) if stretch == fold]
    return kept, left


def with_views(model: LabelModel, own: Replayed, views: Sequence[LabelView]) -> Replayed:
    """A track with further views."""
    record = own.record
    for view in views:
        record = model.after(record, view)
    return replace(own, record=record)
