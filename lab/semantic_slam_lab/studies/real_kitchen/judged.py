"""A run through the kitchen against what stands in it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from semantic_slam.evaluation.classification import expected_calibration_error, negative_log_likelihood
from semantic_slam.evaluation.evaluate import evaluate
from semantic_slam.evaluation.record import Record
from semantic_slam.evaluation.trajectory import RigidMotion, absolute_trajectory_error, align, alignment
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.geometry.pose import planar_from_pose_vector
from semantic_slam.inference.belief import HybridBelief
from semantic_slam_lab.studies.real_kitchen.reference import COUNTS, Standing, standing

LEAST_EXISTENCE = 0.5
FARTHEST_M = 0.5
"""No object that is stated so far from one that is there is that one."""


@dataclass(frozen=True)
class Judged:
    """One run; K keyframes, M objects stated of the classes that are counted, all in the frame of the true poses."""

    metrics: dict[str, Any]
    path: Array  # (K, 2)
    true_path: Array  # (K, 2)
    stated: Array  # (M, 2)
    classes: tuple[str, ...]  # (M,)
    there: Standing


def judged(record: Record, path: Array) -> Judged:
    """Metrics of a run; ``path`` (K, 3) is the robot's as it stands at the end."""
    truth = record.truth
    assert truth is not None
    evaluation, there, last = evaluate(record, truth), standing(record), record.beliefs[-1]
    true_path = evaluation.true_poses[:, :2]
    aligning = alignment(path[:, :2], true_path)
    rows = np.flatnonzero((last.existence > LEAST_EXISTENCE) & _is_counted(last))
    classes = tuple(last.class_names[best] for best in last.class_probabilities[rows].argmax(axis=1))
    stated = aligning.applied(last.object_poses[rows, :2])
    pairs = matched(stated, classes, there)
    errors = {
        name: float(np.linalg.norm(stated[pairs[row]] - there.positions[row])) if row in pairs else None
        for row, name in enumerate(there.names)
    }
    dead = planar_from_pose_vector(evaluation.dead_reckoning)[:, :2]
    metrics = {
        "counts": {name: classes.count(name) for name in COUNTS},
        "position_error_m": errors,
        "ghosts": len(stated) - len(pairs),
        **class_metrics(record, there, aligning),
        "num_objects": int((last.existence > LEAST_EXISTENCE).sum()),
        "num_keyframes": len(record.beliefs),
        "ate_aligned_m": absolute_trajectory_error(aligning.applied(path[:, :2]), true_path),
        "odometry_ate_aligned_m": absolute_trajectory_error(align(dead, true_path), true_path),
        "nees_mean": evaluation.metrics["nees_mean"],
    }
    return Judged(metrics, aligning.applied(path[:, :2]), true_path, stated, classes, there)


def matched(stated: Array, classes: tuple[str, ...], there: Standing) -> dict[int, int]:
    """Row of what is there -> row of what is stated, of its class and near it, one to one."""
    if not len(stated) or not len(there.names):
        return {}
    away = np.linalg.norm(there.positions[:, None] - stated[None], axis=2)
    same = np.array(there.classes)[:, None] == np.array(classes)[None]
    cost = np.where(same & (away <= FARTHEST_M), away, 1e3)
    rows, columns = linear_sum_assignment(cost)
    return {int(row): int(column) for row, column in zip(rows, columns, strict=True) if cost[row, column] < 1e3}


def class_metrics(record: Record, there: Standing, aligning: RigidMotion) -> dict[str, float | None]:
    """Calibration of the classes of what is stated near something that is there, at the end and over all keyframes."""
    final, final_true = _class_rows(record.beliefs[-1:], there, aligning)
    course, course_true = _class_rows(record.beliefs, there, aligning)
    return {
        "class_ece": _known(expected_calibration_error(final, final_true)),
        "class_nll": _known(negative_log_likelihood(final, final_true)),
        "class_ece_online": _known(expected_calibration_error(course, course_true)),
        "class_nll_online": _known(negative_log_likelihood(course, course_true)),
    }


def _class_rows(beliefs: tuple[HybridBelief, ...], there: Standing, aligning: RigidMotion) -> tuple[Array, Index]:
    """(N, C) class probabilities of stated objects, each that nearest to something that is there, and the true (N,)."""
    rows: list[Array] = []
    true: list[int] = []
    for belief in beliefs:
        held = np.flatnonzero(belief.existence > LEAST_EXISTENCE)
        if not len(held):
            continue
        away = np.linalg.norm(aligning.applied(belief.object_poses[held, :2])[:, None] - there.positions, axis=2)
        objects, known = linear_sum_assignment(away)
        for row, column in zip(objects, known, strict=True):
            if away[row, column] <= FARTHEST_M and there.classes[column] in belief.class_names:
                rows.append(belief.class_probabilities[held[row]])
                true.append(belief.class_names.index(there.classes[column]))
    return np.array(rows).reshape(len(rows), len(beliefs[-1].class_names)), np.array(true, dtype=int)


def _is_counted(belief: HybridBelief) -> Flags:
    best = belief.class_probabilities.argmax(axis=1)
    return np.array([belief.class_names[row] in COUNTS for row in best], dtype=bool)


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
