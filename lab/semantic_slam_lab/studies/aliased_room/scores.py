"""One run scored: objects at the end, their classes, associations, poses; and the averages over runs."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.evaluation.association import CLUTTER as NO_CLUSTER
from semantic_slam.evaluation.association import pair_score
from semantic_slam.evaluation.classification import expected_calibration_error, negative_log_likelihood
from semantic_slam.evaluation.mixture import normalised_error_squared
from semantic_slam.evaluation.trajectory import absolute_trajectory_error
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam_lab.studies.aliased_room.data import CLUTTER, Recording
from semantic_slam_lab.studies.aliased_room.methods import Outcome
from semantic_slam_lab.studies.aliased_room.metrics import LEAST_EXISTENCE, gospa, matched
from semantic_slam_lab.studies.own_detector.baselines import product_of_scores

METRICS = {
    "gospa_m": "GOSPA [m]",
    "ghosts": "ghosts",
    "missing": "missing objects",
    "runs_without_ghost": "runs without a ghost",
    "runs_complete": "runs with every object",
    "nll": "class NLL [nats]",
    "ece": "class ECE",
    "association_f1": "association F1",
    "nees": "NEES",
    "ate_m": "ATE [m]",
    "hypotheses": "hypotheses",
    "seconds": "s of processor",
    "faults": "runs that broke off",
}
"""Name in result.json -> words on the page."""


@dataclass(frozen=True)
class Row:
    """One method in one run; N true objects, C classes."""

    scene: int
    draw: int
    metrics: dict[str, float]
    class_probabilities: Array  # (N, C) of the objects that stand for the true ones; even where there is none
    true_classes: NDArray[np.int_]  # (N,)
    fault: str


def score(outcome: Outcome, drive: Recording, draw: int) -> Row:
    """``drive`` is the one that the method was given."""
    existing = outcome.existence > LEAST_EXISTENCE
    places, numbers = outcome.objects[existing], outcome.object_ids[existing]
    stands_for = matched(places, drive.objects)
    names = drive.keyframes[0].measurements.class_names
    classes = _classes(outcome, drive)
    even = np.full(len(names), 1.0 / len(names))
    probabilities = np.array([even if row < 0 else classes.get(int(numbers[row]), even) for row in stands_for])
    true = np.array([names.index(name) for name in drive.classes])
    found = len(outcome.filtered)
    truth = drive.truth[:found]
    ids = {name: number for number, name in enumerate(drive.object_ids)} | {CLUTTER: NO_CLUSTER}
    reference = [ids[name] for own in drive.labels[:found] for name in own]
    estimate = [number for own in outcome.associations[:found] for number in own]
    matches = int((stands_for >= 0).sum())
    metrics = {
        "gospa_m": gospa(places, drive.objects).total_m,
        "ghosts": float(len(places) - matches),
        "missing": float(len(drive.objects) - matches),
        "nll": negative_log_likelihood(probabilities, true),
        "association_f1": pair_score(estimate, reference).f1,
        "nees": float(np.mean(_nees(outcome, truth))),
        "ate_m": absolute_trajectory_error(outcome.poses[:found, :2], truth[:, :2]),
        "hypotheses": float(outcome.hypotheses.mean()),
        "seconds": float(outcome.seconds.sum()),
    }
    return Row(drive.scene, draw, metrics, probabilities, true, outcome.fault)


def _classes(outcome: Outcome, drive: Recording) -> dict[int, Array]:
    """Object id -> (C,) in the order of the measurements' classes.

    The belief's, or, of a method without class models, the product of the network's scores of the detections that it
    associates with the object, as :func:`own_detector.baselines.product_of_scores` has it.
    """
    names = drive.keyframes[0].measurements.class_names
    if outcome.class_names:
        order = [outcome.class_names.index(name) for name in names]
        return {int(n): row[order] for n, row in zip(outcome.object_ids, outcome.classes, strict=True)}
    scores: dict[int, list[Array]] = {}
    for own, keyframe in zip(outcome.associations, drive.keyframes, strict=False):
        for row, number in enumerate(own):
            scores.setdefault(int(number), []).append(keyframe.measurements.class_probability_samples[row].mean(axis=0))
    return {number: product_of_scores(np.array(views)) for number, views in scores.items()}


def _nees(outcome: Outcome, truth: Array) -> Array:
    error = truth - outcome.filtered
    error[:, 2] = wrap_angle(error[:, 2])
    pairs = zip(error, outcome.covariances, strict=True)
    return np.array([normalised_error_squared(e, covariance) for e, covariance in pairs])


def summary(rows: Sequence[Row]) -> dict[str, Any]:
    """Averages over runs; the calibration error is that of all objects of all runs together."""
    means = {name: float(np.mean([row.metrics[name] for row in rows])) for name in rows[0].metrics}
    probabilities = np.concatenate([row.class_probabilities for row in rows])
    true = np.concatenate([row.true_classes for row in rows])
    return {
        **means,
        "ece": expected_calibration_error(probabilities, true),
        "runs_without_ghost": float(np.mean([row.metrics["ghosts"] == 0 for row in rows])),
        "runs_complete": float(np.mean([row.metrics["missing"] == 0 for row in rows])),
        "faults": float(sum(bool(row.fault) for row in rows)),
    }
