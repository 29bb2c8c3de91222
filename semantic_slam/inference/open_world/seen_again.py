"""Detections of known objects, of K candidates: where the objects are then, and what each detection says of the place.

The weight of such a pair is its density times the detection probability, averaged over robot and object given the
pair. Given the detection, the place relative to the robot is about as well known as the detection is accurate, however
little the map knew of it.
"""

from typing import NamedTuple

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.models.noise.heavy_tail import HeavyTail
from semantic_slam.inference.open_world.prediction.prediction import Prediction
from semantic_slam.inference.world.problem import Problem


class SeenAgain(NamedTuple):
    """n pairs of a candidate and an object in reach that it associates with a detection."""

    candidates: Index  # (n,)
    columns: Index  # (n,) among the objects in reach
    points: Array  # (n, d) places in the body frame, at the candidates' modes
    slopes: Array  # (n, m, d) Jacobians of the detections' whitened residuals by these

    @classmethod
    def of(
        cls, problem: Problem, prediction: Prediction, rows: Assignments, object_ids: Index, stands: Flags
    ) -> "SeenAgain":
        """The pairs of K candidates of one parent; ``object_ids`` (K, D) as associated, without what moves.

        ``stands`` (K, D): which detections are of objects that stand still.
        """
        spaces, reached = prediction.component.spaces, prediction.component.objects.ids[prediction.in_reach]
        candidates, numbers = np.nonzero(np.isin(object_ids, reached) & stands)
        robots, objects = rows.column("robot")[candidates], rows.column("object_states")[candidates, numbers]
        relative = spaces.relative_position(robots, objects)
        detections = problem.model.collect(prediction.detections).take(numbers)
        by_object = problem.model.geometry(detections, robots, objects).jacobian_object
        if (tail := HeavyTail.of(problem.detection_errors, prediction.component.outliers)) is not None:
            by_object[rows.column("outlier")[candidates, numbers]] /= tail.width
        return cls(
            candidates=candidates,
            columns=np.searchsorted(reached, object_ids[candidates, numbers]),
            points=relative.point,
            slopes=by_object @ np.swapaxes(relative.by_landmark, -1, -2),
        )
