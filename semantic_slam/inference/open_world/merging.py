"""Near-duplicate hypotheses: the heavier one stays and takes over the other's weight.

Two are near copies when their robots are close, when the objects associated with each recent detection are close, and
when these objects have the same classes. Which of the objects existed before does not matter, but whether a detection
is the second of its object does: it confirms existence, and a hypothesis in which the first was a false alarm, or
another object, must stay until misses or further detections decide. So must hypotheses that are sure of different
objects, wherever these are.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry import so3
from semantic_slam.geometry.arrays import Array, Index, squared_norms
from semantic_slam.geometry.pose import planar_from_pose_vector, wrap_angle


@dataclass(frozen=True, kw_only=True)
class MergeCandidates:
    """The properties by which K hypotheses are compared; R recent detections."""

    poses: Array  # (K, 7) robot in map
    objects: Array  # (K, R, 3) object position of each recent detection [m]; NaN if dropped
    classes: Index  # (K, R + 2) its class, -1 without classes; then noise setting and new ground
    confirms: NDArray[np.bool_]  # (K, R) whether the detection is the second one of its object
    parents: Index  # (K,) parent numbers from 0
    alike: NDArray[np.bool_]  # (P, P) whether two parents are sure of the same objects
    is_spatial: bool = False  # compare 3-D poses; False: x, y and yaw


@dataclass(frozen=True)
class Merged:
    """Hypotheses that remain after merging near copies, heaviest first."""

    kept: Index  # (S,)
    log_weights: Array  # (S,) including what they took over
    count: int  # number of hypotheses taken over


def merge_copies(
    looks: MergeCandidates, log_weights: Array, ids: NDArray[np.uint64], limits: OpenWorldConfiguration
) -> Merged:
    """Merge near copies greedily from the heaviest down; ties break by id."""
    order = np.lexsort((ids, -log_weights))
    if limits.merge_position_m <= 0.0:
        return Merged(order, log_weights[order], 0)
    poses = looks.poses if looks.is_spatial else planar_from_pose_vector(looks.poses)
    kept = np.empty(len(order), dtype=int)
    weights = np.empty(len(order))
    count = 0
    for row in order.tolist():
        original = _near(poses, looks, row, kept[:count], limits)
        if len(original):
            weights[original[0]] = np.logaddexp(weights[original[0]], log_weights[row])
        else:
            kept[count], weights[count] = row, log_weights[row]
            count += 1
    return Merged(kept[:count], weights[:count], len(order) - count)


def _near(poses: Array, looks: MergeCandidates, row: int, others: Index, limits: OpenWorldConfiguration) -> Index:
    """Indices into ``others`` (n,) of the hypotheses that this one is a near copy of, ascending."""
    away, turned = (_apart_in_space if looks.is_spatial else _apart)(poses[row], poses[others])
    found = np.flatnonzero((away <= limits.merge_position_m) & (turned <= limits.merge_heading_rad))
    if not len(found):
        return found
    others = others[found]
    same = (looks.classes[others] == looks.classes[row]).all(axis=1)
    if not limits.merge_ghosts:
        same &= (looks.confirms[others] == looks.confirms[row]).all(axis=1)
        same &= looks.alike[looks.parents[others], looks.parents[row]]
    found, others = found[same], others[same]
    apart = looks.objects[others] - looks.objects[row]
    squared = apart[..., 0] ** 2 + apart[..., 1] ** 2 + apart[..., 2] ** 2  # NaN if dropped: ignored
    return np.asarray(found[~(squared > limits.merge_object_m**2).any(axis=1)])


def _apart(pose: Array, others: Array) -> tuple[Array, Array]:
    """(n,) distance [m] and angle [rad] between a planar robot pose (3,) and others (n, 3)."""
    offset = others - pose
    return np.hypot(offset[:, 0], offset[:, 1]), np.abs(wrap_angle(offset[:, 2]))


def _apart_in_space(pose: Array, others: Array) -> tuple[Array, Array]:
    """(n,) distance [m] and angle [rad] between a pose (7,) and others (n, 7)."""
    turned = so3.log(so3.product(so3.inverse(pose[3:]), others[:, 3:]))
    return np.sqrt(squared_norms(others[:, :3] - pose[:3])), np.sqrt(squared_norms(turned))
