"""Candidate label models: independent of the visible side, with calibrated scores, and dependent on the side.

Object headings are unknown, and equally likely while all sides are equal, so the search must break this symmetry: the
object with the most views of each class is assumed to face ahead, and the sides of its class are initialised with its
words. The headings of all other objects follow from that.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.training.labels.expectation import Expectation, Replayed, expected, replayed
from semantic_slam.training.labels.fit import Fitted, Refit, fitted
from semantic_slam.training.labels.maximisation import BeforeFit, class_shares, habit_shares
from semantic_slam.training.labels.passes import FOLDS, Pass, views_of
from semantic_slam.training.labels.tracks import Track
from semantic_slam.viewpoint.labels.confusion import HIDDEN_NONE
from semantic_slam.viewpoint.labels.model import LabelModel
from semantic_slam.viewpoint.labels.settings import LabelSettings

REPEAT_SHARES, REPEAT_RADS, COUNT_FACTORS = (0.0, 0.5, 0.8, 0.95, 0.99), (0.25, 0.5, 1.0, 2.0), (1.0, 3.0, 10.0, 30.0)
"""Settings that are tried, besides whether scores count. What none of the labels means stays as unknown as it was."""
SCORE_POWERS = (0.0, 0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0)
"""Powers of the scores that are tried for the detector's calibration."""
SECTORS = 12
"""Number of sides of an object, and of its discrete headings."""
BEGINNING = 4.0
"""Initial weight of the views of those objects, which gives the headings an initial reference."""
PATIENCE = 4
"""Consecutive rounds without gain allowed for side-dependent models, until headings agree."""


def alike(start: LabelModel, before: BeforeFit, tracks: Sequence[Track]) -> Fitted:
    """What classes are called from any side, under more settings than before."""
    settings = LabelSettings.grid(REPEAT_SHARES, REPEAT_RADS, COUNT_FACTORS, other_factor=1.0)
    return fitted([replace(start, settings=settings)] * len(FOLDS), _refitted(before), tracks, patience=1)


def by_score(found: Fitted, before: BeforeFit, tracks: Sequence[Track]) -> Fitted:
    """With the detector's scores calibrated, where ``found`` takes them as they are told, or the answers alone."""
    settings, best = found.whole.model.settings, int(np.argmax(found.whole.weights))
    kept = settings.take(
        np.flatnonzero(
            (settings.repeat_rads == settings.repeat_rads[best])
            & (settings.count_factors >= settings.count_factors[best])
        )
    )
    models = [replace(own.model, settings=kept.with_powers(SCORE_POWERS)) for own in found.passes]
    return fitted(models, _refitted(before), tracks, patience=1)


def _refitted(before: BeforeFit) -> Refit:
    """All sides alike, with shares of classes and of habits."""

    def refit(own: Pass, _: int) -> LabelModel:
        shares, habits = class_shares(own.weights @ own.told.classes), habit_shares(own.weights @ own.told.habits)
        return replace(own.model, confusions=(before.fitted(own),), class_shares=shares, habits=habits)

    return refit


def by_side(found: Fitted, before: BeforeFit, tracks: Sequence[Track]) -> Fitted:
    """What classes are called from each side, where ``found`` has all sides alike."""
    bases = [own.model.confusions[-1] for own in found.passes]
    settings = _narrowed(found.whole)

    def refit(own: Pass, place: int) -> LabelModel:
        return replace(own.model, confusions=(before.by_side(own.told, own.weights, bases[place]),))

    models = [
        _begun(replace(own.model, settings=settings), before, tracks, fold)
        for own, fold in zip(found.passes, FOLDS, strict=True)
    ]
    return fitted(models, refit, tracks, PATIENCE)


def _narrowed(whole: Pass) -> LabelSettings:
    """Settings that differ from the likeliest one by how often views repeat, which sides may explain, or by counts."""
    settings, best = whole.model.settings, int(np.argmax(whole.weights))
    same = (settings.score_powers == settings.score_powers[best]) & (settings.repeat_rads == settings.repeat_rads[best])
    return settings.take(np.flatnonzero(same & (settings.count_factors >= settings.count_factors[best])))


def _begun(model: LabelModel, before: BeforeFit, tracks: Sequence[Track], fold: int) -> LabelModel:
    """With sides as the object of each class has them that has the most views."""
    confusion = model.confusions[-1]
    same = replace(confusion, counts=np.repeat(confusion.counts, SECTORS, axis=0))
    turned = replace(model, confusions=(same,), is_lean=False)
    told, best = Expectation.nothing(turned), dict[int, tuple[float, Track, Replayed]]()
    for track in tracks:
        kept, _ = views_of(track, fold)
        seen = replayed(turned, track, kept)
        rows = _ahead(turned, seen.rows).mean(axis=0)
        number = int(np.argmax(rows))
        worth = track.weight * float(rows[number]) * len(kept)
        if worth > best.get(number, (0.0,))[0]:
            best[number] = worth, track, seen
    for _, track, seen in best.values():
        told = told.plus(expected(turned, seen, _ahead(turned, seen.rows)), BEGINNING * track.weight)
    even = np.exp(turned.settings.log_weights)
    return replace(turned, confusions=(before.by_side(told, even, confusion),))


def _ahead(model: LabelModel, rows: Array) -> Array:
    """(R, K) probabilities of rows with all headings of a class taken for the first."""
    moved = np.zeros_like(rows)
    classes = rows[:, :-HIDDEN_NONE].reshape(len(rows), -1, model.num_headings).sum(axis=2)
    moved[:, : -HIDDEN_NONE : model.num_headings] = classes
    moved[:, -HIDDEN_NONE:] = rows[:, -HIDDEN_NONE:]
    return moved
