"""The small problems of candidates from several parents over one set of columns: near objects, then new ones."""

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.evidence.keyframe_problem import KeyframeProblem, PredictedBelief
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.open_world.prediction import Prediction
from semantic_slam.inference.world.problem import Problem

FIXED_HEADING_VARIANCE = 1e-8


def open_keyframe_problem(
    problem: Problem, step: Step, predictions: list[Prediction], object_ids: Index, rows: Assignments
) -> KeyframeProblem:
    """K candidates over ``object_ids`` (O,): objects near some parent, ascending, and then the D that may be born."""
    num_births = len(step.detections)
    predicted = _padded(predictions, object_ids[: len(object_ids) - num_births], num_births)
    if problem.model.num_classes == 0:
        predicted = _without_headings(predicted)
    seen, own = problem.model.collect(step.detections), Assignments(parents=rows.parents, objects=rows.objects)
    return KeyframeProblem.of(problem.space, problem.model, predicted, seen, own)


def _padded(predictions: list[Prediction], known: Index, num_births: int) -> PredictedBelief:
    """Predicted Gaussians of all parents over the same columns; those a parent does not know are never referred to."""
    dimension = predictions[0].predicted.mean.shape[-1]
    columns = 1 + len(known) + num_births
    mean = np.zeros((len(predictions), columns, dimension))
    covariance = np.tile(np.eye(columns * dimension), (len(predictions), 1, 1))
    births = 1 + len(known) + np.arange(num_births)
    for parent, prediction in enumerate(predictions):
        own = np.concatenate([[0], 1 + np.searchsorted(known, prediction.near_ids), births]).astype(int)
        places = (own[:, None] * dimension + np.arange(dimension)).ravel()
        states, spread = _with_births(prediction)
        mean[parent, own] = states
        covariance[parent, places[:, None], places] = spread
    return PredictedBelief(mean, covariance)


def _with_births(prediction: Prediction) -> tuple[Array, Array]:
    """States (1 + M + D, d) and their covariance: robot, near objects, and the objects that D detections start."""
    predicted, births = prediction.predicted, prediction.births
    before, dimension = predicted.covariance[0], predicted.mean.shape[-1]
    if not births:
        return predicted.mean[0], before
    gains = np.concatenate([birth.gain for birth in births])
    cross = gains @ before[:dimension]
    spread = np.block([[before, cross.T], [cross, gains @ before[:dimension, :dimension] @ gains.T]])
    for number, birth in enumerate(births):
        begin = len(before) + number * dimension
        spread[begin : begin + dimension, begin : begin + dimension] += birth.spread
    return np.concatenate([predicted.mean[0], np.array([birth.prior.mean for birth in births])]), spread


def _without_headings(predicted: PredictedBelief) -> PredictedBelief:
    """The same with objects that do not turn: no measurement depends on it, and a wide angle bends their positions."""
    size, dimension = predicted.covariance.shape[-1], predicted.mean.shape[-1]
    headings = np.arange(2 * dimension - 1, size, dimension)
    covariance = predicted.covariance.copy()
    covariance[:, headings], covariance[:, :, headings] = 0.0, 0.0
    covariance[:, headings, headings] = FIXED_HEADING_VARIANCE
    return PredictedBelief(predicted.mean, covariance)
