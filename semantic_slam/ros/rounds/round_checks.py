"""Validity checks of keyframes and commits: motions, covariances, weights, and ids, which are digests."""

import numpy as np

from semantic_slam.geometry.pose import planar_from_covariance
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import Commit
from semantic_slam.inference.states.lineage import next_id
from semantic_slam.messages.standard import is_pose
from semantic_slam.perception.usable_measurements import faults

ROUNDING = 1e-6


def fault_of_commit(commit: Commit, stamp_ns: int) -> str:
    """Why a commit of the keyframe with this stamp is invalid; "" if it is valid."""
    if not len(commit.ids):
        return "without a survivor"
    if len(set(commit.ids.tolist())) < len(commit.ids):
        return "a survivor twice"
    weights = commit.log_weights
    if not np.isfinite(weights).all() or abs(float(np.logaddexp.reduce(weights))) > ROUNDING:
        return "weights that are not normalised"
    for number, parent, step in zip(commit.ids.tolist(), commit.parent_ids.tolist(), commit.steps, strict=True):
        if next_id(parent, stamp_ns, step) != number:
            return "an id that is not that of its survivor"
    return ""


def fault_of_keyframe(keyframe: Keyframe) -> str:
    """Why a keyframe is invalid; "" if it is valid."""
    covariance = planar_from_covariance(keyframe.odometry_covariance)
    if not is_pose(keyframe.odometry):
        return "odometry that is no motion"
    is_told = not np.isnan(covariance).all()
    if is_told and not (np.isfinite(covariance).all() and np.linalg.eigvalsh(covariance).min() > 0.0):
        return "odometry without a covariance"
    told = [array for array in (keyframe.odometry_slopes, keyframe.odometry_shifts) if array is not None]
    if not all(np.isfinite(array).all() for array in told):
        return "slopes that are not finite"
    level = keyframe.level
    if level is not None and not (np.isfinite(level).all() and level[:3].any() and level[3] > 0.0):
        return "gravity without a direction or a variance"
    return next((reason for reason, rows in faults(keyframe.measurements).items() if rows.any()), "")
