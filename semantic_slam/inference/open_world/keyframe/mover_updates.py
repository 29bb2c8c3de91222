"""Update of moving objects by one continuation: detected, missed, decided to be moving, given up, or started."""

from dataclasses import replace

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.open_world.existence import existence_after_miss
from semantic_slam.inference.open_world.moving.moving_objects import PredictedMovers
from semantic_slam.inference.open_world.prediction.prediction import Prediction
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.inference.states.lineage import MOVES, LineageStep
from semantic_slam.inference.states.movers import Movers
from semantic_slam.inference.states.observers import Observers
from semantic_slam.inference.states.tracked_objects import ExistenceUpdate

LIKELY = 0.5
"""Existence above which a moving object is kept even when its position has become too uncertain to recognise it."""


def movers_after(
    prediction: Prediction,
    taken: LineageStep,
    observer: Observers | None,
    update: ExistenceUpdate,
    least_existence: float,
) -> Movers | None:
    """Moving objects after a keyframe, given the one ``observer`` at its mode; None: nothing moves.

    ``update`` is that of the existence of objects standing still. A second detection decides whether an object moves:
    if its history takes it to stand still, it is dropped from the moving objects.
    """
    predicted = prediction.movers
    if predicted is None or observer is None:
        none = prediction.component.movers
        return None if none is None else none.with_rates(update.rates_kept)
    association, moves = np.array(taken.association, dtype=int), np.array(taken.class_assignment) == MOVES
    numbers = np.flatnonzero(moves)
    rows = predicted.movers.rows(association[numbers])
    seen = predicted.observed(rows, numbers, observer).with_rates(update.rates_kept)
    left = np.flatnonzero(~np.isin(predicted.movers.ids, association))
    others = _missed(prediction, predicted, left, update, least_existence).seen_from(observer)
    known = others.joined(_detectable_again(update.rates, seen))
    new = np.flatnonzero(np.isin(association, update.new_ids) & (predicted.shares > 0.0))
    existence = update.new_existence[np.searchsorted(update.new_ids, association[new])]
    return known.take(np.argsort(known.ids)).joined(
        _detectable_again(update.rates, predicted.started(new, association[new], existence, observer))
    )


def _missed(
    prediction: Prediction, predicted: PredictedMovers, left: Index, update: ExistenceUpdate, least_existence: float
) -> Movers:
    """The undetected objects in the rows ``left``, without those that are given up."""
    own, detected = predicted.movers.take(left).with_rates(update.rates_kept), predicted.detected[left]
    if update.rates_kept is not None:
        detected = detected[:, update.rates_kept]
    existence = existence_after_miss(own.existence, detected)
    likely = update.rates.average(existence)
    kept = (likely >= least_existence) & (predicted.recognised[left] | (likely > LIKELY))
    moving = own.moving.copy()
    undecided = ~own.decided
    places = prediction.component.objects.rows(own.ids[undecided])
    assert update.moving is not None
    existence[undecided], moving[undecided] = update.existence[places], update.moving[places]
    kept[undecided] = update.kept[places]
    detectable = own.detectable
    if detectable is not None:
        runs = update.rates.runs
        detectable = runs.next(runs.after(detectable, detected, np.zeros(len(left), dtype=bool)))
        detectable[undecided & kept] = _of_static(prediction, update, own.ids[undecided & kept])
    log_speeds = predicted.log_speeds_missed(update.rates, update.rates_kept)[left]
    own = replace(own, existence=existence, moving=moving, detectable=detectable, log_speeds=log_speeds)
    return own.take(np.asarray(kept))


def _of_static(prediction: Prediction, update: ExistenceUpdate, object_ids: Index) -> Array:
    """(n, G) detectability in the next keyframe of objects that are also kept as static ones."""
    assert update.in_view is not None and update.in_view.detectable is not None
    return np.asarray(
        update.in_view.detectable[np.searchsorted(prediction.component.objects.ids[update.kept], object_ids)]
    )


def _detectable_again(rates: DetectionRates, movers: Movers) -> Movers:
    """Moving objects that were just detected, with their detectability one keyframe later."""
    if movers.detectable is None:
        return movers
    return replace(movers, detectable=rates.runs.next(np.ones(movers.detectable.shape)))
