"""The small problems in which one keyframe's candidates are weighed, of several parents over one set of columns.

The columns are the robot, the objects near some parent's detections, and the objects that may be born.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.evidence.keyframe_problem import KeyframeProblem, PredictedBelief
from semantic_slam.inference.open_world.prediction.prediction import Prediction
from semantic_slam.inference.states.kinds.state_space import StateSpace
from semantic_slam.inference.states.layout import Layout
from semantic_slam.inference.world.problem import Problem

FIXED_ATTITUDE_VARIANCE = 1e-8


def open_keyframe_problem(
    problem: Problem, detections: Sequence[Any], predictions: list[Prediction], object_ids: Index, rows: Assignments
) -> KeyframeProblem:
    """The problem of K candidates over ``object_ids`` (O,): objects near some parent, ascending, then D births.

    ``detections``: D of them, any of which may belong to no object in a candidate.
    """
    num_births = len(detections)
    predicted = _padded(problem.spaces.storage, predictions, object_ids[: len(object_ids) - num_births], num_births)
    if problem.model.num_classes == 0:
        predicted = _without_attitudes(predicted, problem.spaces.landmark)
    candidates = Assignments(parents=rows.parents, objects=rows.objects)
    collected = problem.model.collect(detections)
    return KeyframeProblem.of(problem.spaces, problem.model, predicted, collected, candidates)


def _padded(storage: Layout, predictions: list[Prediction], known: Index, num_births: int) -> PredictedBelief:
    """Predicted Gaussians of all parents over the same columns; columns unknown to a parent are never referred to."""
    layout, count = predictions[0].predicted.layout, len(known) + num_births
    mean = np.zeros((len(predictions), 1 + count, storage.width))
    covariance = np.tile(np.eye(layout.size(count)), (len(predictions), 1, 1))
    births = 1 + len(known) + np.arange(num_births)
    for parent, prediction in enumerate(predictions):
        columns = np.concatenate([[0], 1 + np.searchsorted(known, prediction.near_ids), births]).astype(int)
        places = layout.rows(columns)
        states, spread = _with_births(storage, prediction)
        mean[parent, columns] = states
        covariance[parent, places[:, None], places] = spread
    return PredictedBelief(layout, mean, covariance)


def _with_births(storage: Layout, prediction: Prediction) -> tuple[Array, Array]:
    """States (1 + M + D, s) and joint covariance of the robot, M near objects, and the D objects that may be born."""
    predicted, births = prediction.predicted, prediction.births
    before, layout = predicted.covariance[0], predicted.layout
    if not births:
        return predicted.mean[0], before
    gains = np.concatenate([birth.gain for birth in births])
    robot = layout.block(0)
    cross = gains @ before[robot]
    spread = np.block([[before, cross.T], [cross, gains @ before[robot, robot] @ gains.T]])
    for place, birth in enumerate(births, start=len(predicted.mean[0])):
        spread[layout.block(place), layout.block(place)] += birth.spread
    return storage.stacked(predicted.mean[0], np.array([birth.prior.mean for birth in births])), spread


def _without_attitudes(predicted: PredictedBelief, landmark: StateSpace) -> PredictedBelief:
    """Objects with fixed headings, or attitudes, on which no measurement depends.

    In space beliefs are the same without this, to 1e-14. In the plane they are not where odometry is poor (0.15 m and
    0.1 rad a keyframe): log evidence by up to 2e-4, small weights by 2 %, headings by 0.09 rad, however well modes
    converge.
    """
    turns = np.delete(np.arange(landmark.tangent_size), landmark.position_rows)
    if not len(turns):
        return predicted
    starts = predicted.layout.starts(np.arange(1, predicted.mean.shape[1]))
    attitudes = (starts[:, None] + turns).ravel()
    covariance = predicted.covariance.copy()
    covariance[:, attitudes], covariance[:, :, attitudes] = 0.0, 0.0
    covariance[:, attitudes, attitudes] = FIXED_ATTITUDE_VARIANCE
    return PredictedBelief(predicted.layout, predicted.mean, covariance)
