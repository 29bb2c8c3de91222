"""One keyframe of the map, as JSON-compatible data drawn by the page's script."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.evaluation.history import best_index
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_pose_vector
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.maps.from_belief import MOVES
from semantic_slam.report.drawing.ellipse import ellipses
from semantic_slam.report.shown.space import principal_axes

MOVED_M, CHANGED = 0.01, 0.004
"""An object is written again when it moved this far, or its probabilities, size or height changed this much."""
CERTAIN = 0.99
"""Existence from which on an object is drawn as any other."""
BEFORE_CLASSES = 7
"""Numbers of an object before its class probabilities: x, y, yaw, ellipse, sigma of yaw."""
HARDLY, ALMOST, QUITE = 1e-4, 0.9996, 1e-9
"""What is written of a probability that is smaller, or larger, and how near to 0 or 1 it counts as such."""
NO_HEADING_RAD = 3.142
"""Standard deviation of the heading of a point."""


def keyframe_scene(
    belief: HybridBelief,
    start_ns: int,
    hypotheses: list[list[float]],
    numbers: dict[int, int],
    written: dict[int, Array],
) -> dict[str, Any]:
    """A keyframe with its :func:`hypothesis_rows`, ``start_ns`` being when the run began.

    ``numbers``: place of every object in the page's list, by its id. ``written``: what the page knows of them so far,
    by id, which is brought up to date.
    """
    seen = [numbers.get(int(belief.object_ids[row]), -1) for row in belief.associations[best_index(belief)] if row >= 0]
    return {
        "k": belief.keyframe,
        "t": round((belief.stamp_ns - start_ns) * 1e-9, 2),
        "n": len(belief.hypothesis_ids),
        "h": hypotheses,
        "o": _changed_objects(belief, numbers, written),
        "s": [place for place in seen if place >= 0],
        "e": _faint(belief, numbers),
        **_movers(belief, numbers),
        **_places(belief, numbers),
    }


def hypothesis_rows(belief: HybridBelief, rows: list[int], place: dict[int, int]) -> list[list[float]]:
    """Per hypothesis: place of its parent in the frame before (-1 none), weight, x, y, yaw, ellipse.

    In space z, quaternion and ellipsoid besides.
    """
    floor_plan = [planar_from_pose_vector(belief.poses), ellipses(belief.pose_covariances)]
    space = [] if belief.planar else [belief.poses[:, 2:], principal_axes(belief.pose_covariances)]
    states = np.column_stack([_not_quite(np.exp(belief.log_weights)), *floor_plan, *space])
    return [[place.get(int(belief.parent_ids[row]), -1), *rounded(states[row], 4)] for row in rows]


def _changed_objects(belief: HybridBelief, numbers: dict[int, int], written: dict[int, Array]) -> list[list[float]]:
    """Per changed object: place in the list of objects, x, y, yaw, ellipse, sigma of yaw, class probabilities.

    In space z and ellipsoid besides.
    """
    poses, covariances = belief.object_poses, belief.object_covariances
    states = np.column_stack(
        [
            planar_from_pose_vector(poses),
            ellipses(covariances),
            _heading_sigmas(belief),
            _not_quite(belief.class_probabilities),
            *([] if belief.planar else [poses[:, 2], principal_axes(covariances)]),
        ]
    )
    before = np.array([written.get(int(number), np.full(states.shape[1], np.nan)) for number in belief.object_ids])
    changed = _differs(states, before.reshape(states.shape)) & np.isfinite(states).all(axis=1)
    rows = [row for row in np.flatnonzero(changed) if int(belief.object_ids[row]) in numbers]
    written.update({int(belief.object_ids[row]): states[row] for row in rows})
    classes = slice(BEFORE_CLASSES, BEFORE_CLASSES + len(belief.class_names))
    return [
        [
            numbers[int(belief.object_ids[row])],
            *rounded(states[row, : classes.start]),
            *rounded(states[row, classes], 4),
            *rounded(states[row, classes.stop :]),
        ]
        for row in rows
    ]


def _heading_sigmas(belief: HybridBelief) -> Array:
    """(O,) standard deviations [rad]; objects in space that have no attitude state a variance of 0."""
    variances = belief.object_covariances[:, 5, 5]
    is_point = (variances == 0.0) & (not belief.planar)
    return np.where(is_point, NO_HEADING_RAD, np.sqrt(np.maximum(variances, 0.0)))


def _faint(belief: HybridBelief, numbers: dict[int, int]) -> list[list[float]]:
    """Place in the list of objects and existence of those that may not exist."""
    rows = zip(belief.object_ids.tolist(), belief.existence.tolist(), strict=True)
    return [[numbers[own], round(value, 2)] for own, value in rows if own in numbers and value < CERTAIN]


def _movers(belief: HybridBelief, numbers: dict[int, int]) -> dict[str, list[list[float]]]:
    """Per object that moves: place in the list of objects, velocity along x and y [m/s]; nothing where none does."""
    rows = [row for row in np.flatnonzero(belief.moving > MOVES) if int(belief.object_ids[row]) in numbers]
    moving = [[numbers[int(belief.object_ids[row])], *rounded(belief.object_velocities[row, :2])] for row in rows]
    return {"m": moving} if moving else {}


def _places(belief: HybridBelief, numbers: dict[int, int]) -> dict[str, list[list[float]]]:
    """Per place of an object that is in one of several: place in the list of objects, probability, x, y, ellipse.

    In space z and ellipsoid besides.
    """
    ids, means, covariances = belief.object_ids[belief.place_objects], belief.place_means, belief.place_covariances
    space = [] if belief.planar else [means[:, 2:], principal_axes(covariances)]
    states = np.column_stack([belief.place_probabilities, means[:, :2], ellipses(covariances), *space])
    rows = [[numbers[own], *rounded(state)] for own, state in zip(ids.tolist(), states, strict=True) if own in numbers]
    return {"p": rows} if rows else {}


def _not_quite(probabilities: Array) -> Array:
    """Probabilities that rounding makes neither certain nor impossible if they are not."""
    is_open = (probabilities > QUITE) & (probabilities < 1.0 - QUITE)
    return np.where(is_open, np.clip(probabilities, HARDLY, ALMOST), probabilities)


def _differs(states: Array, before: Array) -> NDArray[np.bool_]:
    """(O,) whether states differ enough to be written; those never written before are NaN, and do."""
    step = np.abs(states - before)
    same = (step[:, [0, 1, 3, 4]] <= MOVED_M).all(axis=1) & (step[:, BEFORE_CLASSES:] <= CHANGED).all(axis=1)
    return np.asarray(~same | np.isnan(before[:, 0]))


def rounded(values: Any, digits: int = 3) -> Any:
    """``values`` as a list of Python's numbers; None for None."""
    return None if values is None else [round(float(value), digits) for value in values]
