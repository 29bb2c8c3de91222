"""The small problems of candidates from several parents over one set of columns: near objects, then new ones."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.inference.laplace import Mode
from semantic_slam.inference.linear_weights import Evaluated
from semantic_slam.inference.outlook import Outlook
from semantic_slam.inference.problem import Problem
from semantic_slam.inference.stack import Predicted, Rows, Stack
from semantic_slam.inference.step import Step

Array = NDArray[np.float64]
Index = NDArray[np.int_]

FIXED_HEADING_VARIANCE = 1e-8


@dataclass(frozen=True)
class SmallProblems:
    """K candidates."""

    object_ids: list[int]  # the columns that the stack's rows refer to
    stack: Stack

    @classmethod
    def of(
        cls, problem: Problem, step: Step, outlooks: list[Outlook], born: Index, parents: Index, ids: Index
    ) -> "SmallProblems":
        """``born`` (D,) ids that the detections would start, ``parents`` (K,), ``ids`` (K, D) associations."""
        known = np.unique(np.concatenate([outlook.near_ids for outlook in outlooks]))
        predicted = _padded(outlooks, known, len(born))
        if problem.model.num_classes == 0:
            predicted = _without_headings(predicted)
        object_ids = np.concatenate([known, born]).astype(int)
        rows = Rows(parents, np.searchsorted(object_ids, ids))
        stack = Stack.of(problem.manifold, problem.model, predicted, problem.model.collect(step.detections), rows)
        return cls(object_ids.tolist(), stack)


def evaluated(stack: Stack, mode: Mode) -> Evaluated:
    """States and covariances of K candidates at their modes; objects are distinct, so that every slot is used."""
    states, covariances = stack.marginals(mode.y, mode.hessian)
    at_mode = np.zeros(len(states))
    return Evaluated(mode.log_evidence, states[:, 0], covariances[:, 0], states[:, 1:], covariances[:, 1:], at_mode)


def _padded(outlooks: list[Outlook], known: Index, num_births: int) -> Predicted:
    """Predicted Gaussians of all parents over the same columns; those a parent does not know are never referred to."""
    dimension = outlooks[0].predicted.mean.shape[-1]
    columns = 1 + len(known) + num_births
    mean = np.zeros((len(outlooks), columns, dimension))
    covariance = np.tile(np.eye(columns * dimension), (len(outlooks), 1, 1))
    births = 1 + len(known) + np.arange(num_births)
    for parent, outlook in enumerate(outlooks):
        own = np.concatenate([[0], 1 + np.searchsorted(known, outlook.near_ids), births]).astype(int)
        places = (own[:, None] * dimension + np.arange(dimension)).ravel()
        states, spread = _with_births(outlook)
        mean[parent, own] = states
        covariance[parent, places[:, None], places] = spread
    return Predicted(mean, covariance)


def _with_births(outlook: Outlook) -> tuple[Array, Array]:
    """States (1 + M + D, d) and their covariance: robot, near objects, and the objects that D detections start."""
    predicted, births = outlook.predicted, outlook.births
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


def _without_headings(predicted: Predicted) -> Predicted:
    """The same with objects that do not turn: no measurement depends on it, and a wide angle bends their positions."""
    size, dimension = predicted.covariance.shape[-1], predicted.mean.shape[-1]
    headings = np.arange(2 * dimension - 1, size, dimension)
    covariance = predicted.covariance.copy()
    covariance[:, headings], covariance[:, :, headings] = 0.0, 0.0
    covariance[:, headings, headings] = FIXED_HEADING_VARIANCE
    return Predicted(predicted.mean, covariance)
