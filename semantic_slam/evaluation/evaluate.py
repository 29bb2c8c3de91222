"""Evaluation of a recorded run against its bag's ground truth: the report's ``metrics`` and their time series."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.evaluation import classification, mixture, trajectory
from semantic_slam.evaluation.association import CLUTTER, annotated_pair_score, objects_without_reference, pair_score
from semantic_slam.evaluation.correspondence import match_objects, told_by_map
from semantic_slam.evaluation.history import (
    UNKNOWN,
    UNMATCHED,
    Ids,
    best_history,
    best_index,
    first_settled,
    lineage,
    true_association_probability,
)
from semantic_slam.evaluation.record import GroundTruth, Record, json_object
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.moments import matched_moments
from semantic_slam.geometry.pose import PLANAR_AXES
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.world.map_prior import parse_map_prior

EXISTS = 0.5
"""Least probability of existence of an object that is counted."""


@dataclass(frozen=True)
class Evaluation:
    """Metrics and time series of a run of K keyframes; NaN where ground truth or an input is missing."""

    matches: dict[str, int]  # true object id -> object id
    true_associations: list[Ids]  # K x (D,)
    true_classes: dict[int, str]  # object id -> class name
    true_association_probability: Array  # (K,)
    true_poses: Array  # (K, 7)
    final_poses: Array  # (K, 7) of the ancestors of the final best hypothesis
    dead_reckoning: Array  # (K, 7) from the prior mean
    dead_reckoning_true_start: Array  # (K, 7)
    nees: Array  # (K,)
    metrics: dict[str, float | int | None]


def evaluate(record: Record, truth: GroundTruth) -> Evaluation:
    """All metrics of ``record``; unknown ones are NaN."""
    beliefs = record.beliefs
    stamps = np.array([belief.stamp_ns for belief in beliefs], dtype=np.int64)
    ancestors, found = lineage(beliefs), best_history(beliefs)
    matches = _matches(record, truth, found)
    true_associations = [_true_objects(belief, truth, matches) for belief in beliefs]
    probability = true_association_probability(beliefs, true_associations)
    true_classes = _true_classes(truth, matches)
    true_poses = trajectory.interpolate(truth.trajectory, stamps)
    final_poses = poses_of(beliefs, ancestors)
    dead, dead_true = dead_reckonings(record, truth, stamps)
    nees = np.array([_nees(belief, pose) for belief, pose in zip(beliefs, true_poses, strict=True)])
    metrics = {
        **_association_metrics(beliefs, found, true_associations, truth, probability),
        **_class_metrics(beliefs, true_classes),
        **_trajectory_metrics(beliefs, final_poses, dead, dead_true, true_poses),
        "nees_mean": _mean(nees),
    }
    return Evaluation(
        matches, true_associations, true_classes, probability, true_poses, final_poses, dead, dead_true, nees, metrics
    )


def poses_of(beliefs: tuple[HybridBelief, ...], ancestors: list[int]) -> Array:
    """(K, 7) robot pose of hypothesis ``ancestors[k]`` at every keyframe, NaN where it is -1."""
    rows = [
        belief.poses[index] if index >= 0 else np.full(7, np.nan)
        for belief, index in zip(beliefs, ancestors, strict=True)
    ]
    return np.array(rows).reshape(-1, 7)


def dead_reckonings(record: Record, truth: GroundTruth | None, stamps: NDArray[np.int64]) -> tuple[Array, Array]:
    """(K, 7) odometry alone, started at the mean of the robot's prior and at its true pose; NaN where not known."""
    nothing = np.full((len(stamps), 7), np.nan)
    if not len(record.odometry) or not len(stamps):
        return nothing, nothing
    moments = np.concatenate([record.odometry.stamps_ns[:1], stamps])
    odometry = trajectory.interpolate(record.odometry, moments)
    from_prior = _reckon(record.run.initial_pose, odometry, 0)
    if truth is None:
        return from_prior[1:], nothing
    true = trajectory.interpolate(truth.trajectory, moments)
    known = np.flatnonzero(np.isfinite(true[:, 0]) & np.isfinite(odometry[:, 0]))
    from_truth = _reckon(true[known[0]], odometry, int(known[0])) if len(known) else np.full_like(odometry, np.nan)
    return from_prior[1:], from_truth[1:]


def _reckon(start: Array, odometry: Array, row: int) -> Array:
    poses = np.full_like(odometry, np.nan)
    rows = row + np.flatnonzero(np.isfinite(odometry[row:, 0]))
    if len(rows) and rows[0] == row:
        poses[rows] = trajectory.dead_reckoning(start, odometry[rows])
    return poses


def _matches(record: Record, truth: GroundTruth, history: list[Ids | None]) -> dict[str, int]:
    pairs = [
        (true, int(number))
        for belief, found in zip(record.beliefs, history, strict=True)
        if found is not None and belief.stamp_ns in truth.associations
        for true, number in zip(_true_names(belief, truth), found, strict=True)
        if true
    ]
    true_ids = {true for names in truth.associations.values() for true in names if true}
    true_ids |= set(truth.objects.object_ids) if truth.objects else set()
    return match_objects(sorted(true_ids), _told(record, truth), pairs)


def _told(record: Record, truth: GroundTruth) -> dict[str, int]:
    """Object ids by true id, as the names of a run with given identities and those of the map prior tell."""
    named: dict[str, int] = {}
    if record.beliefs and json_object(record.run.configuration).get("association") == "given":
        last = record.beliefs[-1]  # elsewhere names are not those of the bag's identities
        named = {name: int(n) for name, n in zip(last.object_names, last.object_ids, strict=True) if name}
    if not record.run.map_prior:
        return named
    by_map = told_by_map(parse_map_prior(record.run.map_prior, "run configuration"), _true_places(truth))
    return named | {true: number for true, number in by_map.items() if true not in named}


def _true_places(truth: GroundTruth) -> dict[str, Array]:
    """(3,) place in map [m] by true id, where it is known."""
    if truth.objects is None:
        return {}
    rows = zip(truth.objects.object_ids, truth.objects.poses[:, :3], strict=True)
    return {true: place for true, place in rows if np.isfinite(place).all()}


def _true_names(belief: HybridBelief, truth: GroundTruth) -> list[str]:
    names = truth.associations[belief.stamp_ns]
    return [names[row] if row < len(names) else "" for row in belief.detection_ids]


def _true_objects(belief: HybridBelief, truth: GroundTruth, matches: dict[str, int]) -> Ids:
    if belief.stamp_ns not in truth.associations:
        return np.full(len(belief.detection_ids), UNKNOWN, dtype=np.int64)
    ids = [matches.get(name, UNMATCHED) if name else -1 for name in _true_names(belief, truth)]
    return np.array(ids, dtype=np.int64)


def _true_classes(truth: GroundTruth, matches: dict[str, int]) -> dict[int, str]:
    if truth.objects is None:
        return {}
    rows = zip(truth.objects.object_ids, truth.objects.class_names, strict=True)
    return {matches[true]: name for true, name in rows if true in matches}


def _association_metrics(
    beliefs: tuple[HybridBelief, ...],
    history: list[Ids | None],
    true: list[Ids],
    truth: GroundTruth,
    probability: Array,
) -> dict[str, float | int | None]:
    """Association metrics; clusters use the true ids directly, so a missing object match costs no pair."""
    if not truth.associations:
        names = ("precision", "recall", "f1", "f1_annotated", "right")
        nothing = {f"association_{name}": float("nan") for name in names}
        return {**nothing, "keyframe_disambiguated": None}
    estimate: list[int] = []
    reference: list[int] = []
    right: list[bool] = []
    numbers: dict[str, int] = {"": -1}
    for belief, found, objects in zip(beliefs, history, true, strict=True):
        if found is not None and belief.stamp_ns in truth.associations:
            estimate.extend(found.tolist())
            reference.extend(numbers.setdefault(name, len(numbers)) for name in _true_names(belief, truth))
            right.extend((found == objects).tolist())
    score, settled = pair_score(estimate, reference), first_settled(probability)
    return {
        "association_precision": score.precision,
        "association_recall": score.recall,
        "association_f1": score.f1,
        "association_f1_annotated": annotated_pair_score(estimate, reference).f1,
        "detections_without_true_id": sum(true <= CLUTTER for true in reference),
        "objects_without_true_id": _num_without_true_id(beliefs[-1], estimate, reference),
        "association_right": _mean(np.array(right, dtype=float)),
        "keyframe_disambiguated": None if settled is None else beliefs[settled].keyframe,
    }


def _num_without_true_id(last: HybridBelief, estimate: list[int], reference: list[int]) -> int:
    """Number of objects that exist at the end, to most of whose detections no true id is known."""
    there = last.object_ids[last.existence > EXISTS].tolist()
    return len(objects_without_reference(estimate, reference).intersection(there))


def _class_metrics(beliefs: tuple[HybridBelief, ...], true_classes: dict[int, str]) -> dict[str, float | int | None]:
    final, final_true = class_rows(beliefs[-1:], true_classes)
    course, course_true = class_rows(beliefs, true_classes)
    true = final[np.arange(len(final_true)), final_true]
    return {
        "min_true_class_probability": float(true.min()) if len(true) else float("nan"),
        "class_nll": classification.negative_log_likelihood(final, final_true),
        "class_ece": classification.expected_calibration_error(final, final_true),
        "class_nll_online": classification.negative_log_likelihood(course, course_true),
        "class_ece_online": classification.expected_calibration_error(course, course_true),
    }


def class_rows(beliefs: tuple[HybridBelief, ...], true_classes: dict[int, str]) -> tuple[Array, NDArray[np.int_]]:
    """(N, C) class probabilities of all objects with a known true class, over ``beliefs``, and (N,) those classes."""
    rows: list[Array] = []
    true: list[int] = []
    for belief in beliefs:
        for number, probabilities in zip(belief.object_ids, belief.class_probabilities, strict=True):
            name = true_classes.get(int(number))
            if name in belief.class_names:
                rows.append(probabilities)
                true.append(belief.class_names.index(name))
    width = len(beliefs[-1].class_names) if beliefs else 0
    return np.array(rows).reshape(len(rows), width), np.array(true, dtype=int)


def _trajectory_metrics(
    beliefs: tuple[HybridBelief, ...], final: Array, dead: Array, dead_true: Array, true: Array
) -> dict[str, float | int | None]:
    axes = 2 if beliefs and beliefs[-1].planar else 3
    online = poses_of(beliefs, [best_index(belief) for belief in beliefs])
    error = trajectory.absolute_trajectory_error
    reference = true[:, :axes]
    return {
        "ate_m": error(final[:, :axes], reference),
        "ate_aligned_m": error(trajectory.align(final[:, :axes], reference), reference),
        "ate_online_m": error(online[:, :axes], reference),
        "dead_reckoning_ate_m": error(dead[:, :axes], reference),
        "dead_reckoning_true_start_ate_m": error(dead_true[:, :axes], reference),
    }


def _nees(belief: HybridBelief, true_pose: Array) -> float:
    if not np.isfinite(true_pose).all():
        return float("nan")
    mean, covariance = matched_moments(np.exp(belief.log_weights), belief.poses, belief.pose_covariances)
    axes = list(PLANAR_AXES) if belief.planar else list(range(6))
    error = mixture.pose_error(true_pose[None], mean)[0]
    return mixture.normalised_error_squared(error[axes], covariance[np.ix_(axes, axes)])


def _mean(values: Array) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else float("nan")
