"""The small problems of candidates from several parents over one set of columns: near objects, then new ones."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.evidence.keyframe_problem import Assignments, KeyframeProblem, PredictedBelief
from semantic_slam.inference.evidence.laplace import Mode
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.open_world.linear_evidence import EvaluatedAssignments
from semantic_slam.inference.open_world.prediction import Prediction
from semantic_slam.inference.problem import Problem

FIXED_HEADING_VARIANCE = 1e-8


@dataclass(frozen=True)
class OpenKeyframeProblem:
    """K candidates."""

    object_ids: list[int]  # the columns that the stack's rows refer to
    stack: KeyframeProblem

    @classmethod
    def of(
        cls, problem: Problem, step: Step, predictions: list[Prediction], born: Index, parents: Index, ids: Index
    ) -> "OpenKeyframeProblem":
        """``born`` (D,) ids that the detections would start, ``parents`` (K,), ``ids`` (K, D) associations."""
        known = np.unique(np.concatenate([prediction.near_ids for prediction in predictions]))
        predicted = _padded(predictions, known, len(born))
        if problem.model.num_classes == 0:
            predicted = _without_headings(predicted)
        object_ids = np.concatenate([known, born]).astype(int)
        rows = Assignments(parents, np.searchsorted(object_ids, ids))
        stack = KeyframeProblem.of(
            problem.space, problem.model, predicted, problem.model.collect(step.detections), rows
        )
        return cls(object_ids.tolist(), stack)


def at_modes(stack: KeyframeProblem, mode: Mode) -> EvaluatedAssignments:
    """States and covariances of K candidates at their modes; objects are distinct, so that every slot is used."""
    states, covariances = stack.marginals(mode.y, mode.hessian)
    at_mode = np.zeros(len(states))
    return EvaluatedAssignments(
        mode.log_evidence, states[:, 0], covariances[:, 0], states[:, 1:], covariances[:, 1:], at_mode
    )


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
