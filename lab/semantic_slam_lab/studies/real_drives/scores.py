"""Every metric of one run over one drive; None where the drive has no truth for it."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from semantic_slam.evaluation import mixture, trajectory
from semantic_slam.evaluation.association import CLUTTER, annotated_pair_score, pair_score
from semantic_slam.evaluation.clusters import cluster_score, clusters_of, majority, num_duplicates
from semantic_slam.evaluation.pairs import pair_calibration
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import PLANAR_AXES, planar_from_pose_vector
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.messages.ground_truth import MOVING
from semantic_slam_lab.studies.aliased_room.metrics import gospa
from semantic_slam_lab.studies.real_drives.ceiling import matched
from semantic_slam_lab.studies.real_drives.judged import Judged, votes

CLUSTER_M = 0.5
"""Landmarks nearer to each other than this are of one cluster."""
GHOST_M = 1.0
LEAST_DETECTIONS = 10
"""Detections of a true mover from which on it has to be called one."""

EVERY_METRIC = (
    *("ate_aligned_m", "dead_reckoning_ate_aligned_m", "rpe_m_per_m", "nees_mean", "region95_held"),
    *("region95_median_radius_m", "log_density", "association_f1", "association_f1_annotated"),
    *("association_f1_clusters", "f1_of_ceiling"),
    *("pair_right_at_90", "pair_ece", "num_objects", "num_true_objects", "duplicates", "ghosts", "gospa_m"),
    *("parked_recall", "moving_recall", "robots_called_moving", "real_time_factor", "cpu_s"),
)
"""What a row of the result has in any case: None where neither the drive nor the method tells."""

Metrics = dict[str, float | int | None]


def metrics_of(run: Judged) -> Metrics:
    """All of one run but its times."""
    found = {
        **pose_metrics(run),
        **path_metrics(run.path, run.true_path),
        "dead_reckoning_ate_aligned_m": aligned_error(dead_reckoning(run), run.true_path),
        **association_metrics(run),
        **object_metrics(run),
    }
    return {name: known(value) for name, value in found.items()}


def known(value: Any) -> float | int | None:
    """A number as JSON has it; None for NaN."""
    if value is None or isinstance(value, int):
        return value
    return float(value) if np.isfinite(value) else None


def path_metrics(path: Array, true_path: Array) -> dict[str, float]:
    """Errors of the path (K, 3) as it stands at the end."""
    return {
        "ate_aligned_m": aligned_error(path, true_path),
        "rpe_m_per_m": trajectory.relative_error_per_metre(path, true_path),
    }


def aligned_error(path: Array, true_path: Array) -> float:
    """ATE [m] in the plane after alignment."""
    moved = trajectory.align(path[:, :2], true_path[:, :2])
    return trajectory.absolute_trajectory_error(moved, true_path[:, :2])


def dead_reckoning(run: Judged) -> Array:
    """(K, 3) odometry alone."""
    return planar_from_pose_vector(run.evaluation.dead_reckoning)


def pose_metrics(run: Judged) -> dict[str, float | None]:
    """Honesty of the pose at each keyframe at its time, unaligned."""
    names = ("nees_mean", "region95_held", "region95_median_radius_m", "log_density")
    if not run.has_poses:
        return dict.fromkeys(names)
    pairs = zip(run.record.beliefs, run.evaluation.true_poses, strict=True)
    rows = np.array([_pose_row(belief, pose) for belief, pose in pairs if np.isfinite(pose).all()])
    held, radius, density = rows.T
    values = (run.evaluation.metrics["nees_mean"], held.mean(), np.median(radius), density.mean())
    return dict(zip(names, values, strict=True))


def _pose_row(belief: HybridBelief, true_pose: Array) -> tuple[float, float, float]:
    """Whether the region of 95 % holds the true position, its radius [m], log density of the true pose."""
    held, radius = mixture.position_region(
        np.exp(belief.log_weights), belief.poses[:, :2], belief.pose_covariances[:, :2, :2], true_pose[:2]
    )
    density = mixture.log_density(belief.log_weights, belief.poses, belief.pose_covariances, true_pose, PLANAR_AXES)
    return float(held), radius, density


def association_metrics(run: Judged) -> Metrics:
    """Scores of detections with each other: pairs, clusters, pairs' probabilities, the share of what can be reached."""
    numbers = run.numbers()
    pairs = pair_calibration(run.weights, run.objects, numbers.tolist())
    f1 = pair_score(run.estimate, numbers.tolist()).f1
    ceiling = ceiling_f1(run)
    found: Metrics = {
        "association_f1": f1,
        "association_f1_annotated": annotated_pair_score(run.estimate, numbers.tolist()).f1,
        "f1_of_ceiling": None if ceiling is None else f1 / ceiling,
        "ceiling_f1": ceiling,
        "pair_right_at_90": pairs.right_at_90,
        "pair_ece": pairs.ece,
        "pair_ece_of_stated": pairs.ece_of_stated,
        "association_f1_clusters": None,
        "duplicates": None,
    }
    fixed = run.seen_fixed
    if not fixed:
        return found
    cluster = dict(zip(fixed, clusters_of(np.array(list(fixed.values())), CLUSTER_M).tolist(), strict=True))
    true = [cluster.get(name, CLUTTER) for name in run.names]
    of_objects = majority(run.estimate, true)
    stated = set(run.stated.ids.tolist())
    of_stated = {number: own for number, own in of_objects.items() if number in stated}
    return found | {
        "association_f1_clusters": cluster_score(run.estimate, true).f1,
        "duplicates": num_duplicates(of_stated, Counter(cluster.values())),
    }


def ceiling_f1(run: Judged) -> float | None:
    """Pairwise F1 of the matcher that is told the true poses and objects; None where these are not known, or move."""
    fixed, moves = run.fixed, any(name.startswith(MOVING) for name in run.names)
    if not fixed or moves or not run.has_poses:
        return None
    places, estimate = np.array(list(fixed.values())), np.full(len(run.names), CLUTTER)
    for keyframe in np.unique(run.keyframes):
        pose, own = run.true_path[keyframe], np.flatnonzero(run.keyframes == keyframe)
        seen = run.record.measurements[run.record.beliefs[keyframe].stamp_ns]
        rows = np.searchsorted(seen.detection_ids, run.detection_ids[own])
        if np.isfinite(pose).all():
            estimate[own] = matched(pose, places, seen.ranges_m[rows], seen.bearings_rad[rows])
    return pair_score(estimate.tolist(), run.numbers().tolist()).f1


def object_metrics(run: Judged) -> Metrics:
    """Scores of the map at the end."""
    still, fixed = run.stated.positions[~run.stated.moves], run.seen_fixed
    found: Metrics = {
        "num_objects": len(still),
        "num_true_objects": len({name for name in run.names if name and not name.startswith(MOVING)}),
        "gospa_m": None,
        "ghosts": None,
        "moving_recall": moving_recall(run.names, run),
    }
    if not run.has_poses or not fixed:
        return found
    return found | map_metrics(run.aligning.applied(still), np.array(list(fixed.values())), list(run.fixed.values()))


def map_metrics(objects: Array, seen: Array, every: list[Array]) -> Metrics:
    """GOSPA of (O, 2) aligned objects against the (S, 2) true ones that were seen; ghosts are far from ``every``."""
    away = np.linalg.norm(objects[:, None] - np.array(every)[None], axis=-1).min(axis=1, initial=np.inf)
    return {"gospa_m": gospa(objects, seen).total_m, "ghosts": int((away > GHOST_M).sum())}


def moving_recall(names: Sequence[str], run: Judged) -> float | None:
    """Share of the true movers, seen often enough, that some object stands for which is said to move.

    ``names`` (N,) true object of every detection; those of movers begin with ``MOVING``.
    """
    counts = Counter(names)
    movers = {name for name, count in counts.items() if name.startswith(MOVING) and count >= LEAST_DETECTIONS}
    standing_for = votes(names, run.estimate)
    called = {standing_for.get(int(number)) for number in run.stated.ids[run.stated.moves]}
    return len(movers & called) / len(movers) if movers else None
