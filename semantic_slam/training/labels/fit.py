"""Expectation-maximisation of label models, repeated until the held-out log evidence stops rising.

Each stretch of the drives is held out once: its words are evaluated by the model fitted to all other stretches, given
the other views of the same objects.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.inference.semantics.detector.new_classes import NewClasses
from semantic_slam.training.labels.passes import FOLDS, Pass, passed
from semantic_slam.training.labels.tracks import Track
from semantic_slam.viewpoint.labels.model import LabelModel

MOST_ROUNDS = 20
LEAST_GAIN = 0.1
"""Smallest gain of held-out log evidence [nats] of a useful round."""


@dataclass(frozen=True, kw_only=True)
class Fitted:
    """Cross-validation models, each fitted without one stretch, the last to all; they share their settings."""

    passes: tuple[Pass, ...]  # of ``FOLDS``
    rounds: int

    @property
    def held_out(self) -> float:
        """Log evidence of every stretch under the model without it, in nats."""
        return sum(own.gain for own in self.passes[:-1])

    @property
    def whole(self) -> Pass:
        """The pass of the model that leaves nothing out."""
        return self.passes[-1]


Refit = Callable[[Pass, int], LabelModel]
"""A model after one round, from the pass of the one before and its place in ``FOLDS``."""


def fitted(models: Sequence[LabelModel], refit: Refit, tracks: Sequence[Track], patience: int) -> Fitted:
    """From ``models``, one for each of ``FOLDS``; so many rounds in a row may add nothing before it ends."""
    best = found = as_they_are(models, tracks)
    while found.rounds < min(MOST_ROUNDS, best.rounds + patience):
        models = [refit(own, place) for place, own in enumerate(found.passes)]
        found = replace(as_they_are(models, tracks), rounds=found.rounds + 1)
        if found.held_out >= best.held_out + LEAST_GAIN:
            best = found
    return best


def with_known_classes(own: Fitted, tracks: Sequence[Track], counts: float) -> Fitted:
    """Models that are not fitted, with shares of classes as at the end of a run that has seen all of these objects.

    A run learns them on its way (:class:`NewClasses`); a fit has them from all of its runs, and is held against models
    that have them, too. ``counts``: objects per class that the shares before count as.
    """

    def learned(one: Pass) -> LabelModel:
        shares, objects = one.model.class_shares, one.weights @ one.told.classes
        ratios = NewClasses(shares=shares, counts=counts * len(shares)).log_ratios(objects[None])
        return replace(one.model, class_shares=shares * np.exp(ratios))

    return as_they_are([learned(one) for one in own.passes], tracks)


def as_they_are(models: Sequence[LabelModel], tracks: Sequence[Track]) -> Fitted:
    """Models that are not changed."""
    passes = tuple(passed(model, tracks, fold) for model, fold in zip(models, FOLDS, strict=True))
    return Fitted(passes=passes, rounds=0)
