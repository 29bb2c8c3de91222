"""The pairs of known objects and detections that a keyframe's candidates consist of."""

import numpy as np

from semantic_slam.geometry.arrays import Index
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.open_world.prediction.prediction import Prediction
from semantic_slam.inference.open_world.seen_again import SeenAgain
from semantic_slam.inference.world.problem import Problem


def associated_pairs(
    problem: Problem, prediction: Prediction, rows: Assignments, pairs: tuple[Index, ...], columns: Index
) -> SeenAgain:
    """Pairs of K candidates of one parent.

    ``pairs``: the candidates (n,) and detections (n,) of those that are of objects in reach that stand still, which are
    ``columns`` (n,) among the objects in reach.
    """
    (candidates, numbers), spaces = pairs, prediction.component.spaces
    robots, objects = rows.column("robot")[candidates], rows.column("object_states")[candidates, numbers]
    relative = spaces.relative_position(robots, objects)
    detections = problem.model.collect(prediction.detections).take(numbers)
    by_object = problem.model.geometry(detections, robots, objects).jacobian_object
    if (tail := problem.tail_of(prediction.component)) is not None:
        by_object[rows.column("outlier")[candidates, numbers]] /= tail.width
    return SeenAgain(
        candidates=candidates,
        columns=columns,
        detections=numbers,
        points=relative.point,
        slopes=by_object @ np.swapaxes(relative.by_landmark, -1, -2),
        at_modes=problem.open_world.learn_region,
    )
