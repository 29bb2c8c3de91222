"""What a commit itself reveals of being wrong: ids are digests of what they name, and weights are those of a belief."""

import numpy as np

from semantic_slam.inference.protocol import Commit
from semantic_slam.inference.states.identity import hypothesis_id

ROUNDING = 1e-6


def fault_of(commit: Commit, stamp_ns: int) -> str:
    """Why a commit of the keyframe with this stamp cannot be followed; "" when it can."""
    if not len(commit.ids):
        return "without a survivor"
    if len(set(commit.ids.tolist())) < len(commit.ids):
        return "a survivor twice"
    weights = commit.log_weights
    if not np.isfinite(weights).all() or abs(float(np.logaddexp.reduce(weights))) > ROUNDING:
        return "weights that are not normalised"
    for number, parent, step in zip(commit.ids.tolist(), commit.parent_ids.tolist(), commit.steps, strict=True):
        if hypothesis_id(parent, stamp_ns, step.association, step.class_assignment, step.mode) != number:
            return "an id that is not that of its survivor"
    return ""
