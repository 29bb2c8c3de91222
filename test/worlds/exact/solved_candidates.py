"""Candidates of one object, id 0, whose least-squares problems are solved."""

import numpy as np

from semantic_slam.inference.evidence.keyframe_problem import KeyframeProblem
from semantic_slam.inference.evidence.laplace import Mode
from semantic_slam.inference.evidence.weighed_associations import WeighedAssociations


def candidates_of(problem: KeyframeProblem, mode: Mode) -> WeighedAssociations:
    """With the states at the modes; nothing was left out."""
    left_out = np.full(1 + int(problem.rows.parents.max()), -np.inf)
    solved = WeighedAssociations(
        assignments=problem.rows, object_ids=np.zeros(1, dtype=int), log_left_out=left_out, problem=problem, mode=mode
    )
    return solved.at_modes()
