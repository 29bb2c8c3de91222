"""One method over one drive, in a process of its own: import, run, score."""

import os
import tempfile
import time
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.errors import SemanticSlamError
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.evaluation.record import Record
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.noise.noise_settings import DEPTH, DISTANCE
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.pipeline.offline import run_bag
from semantic_slam_lab.studies.real_drives import batch
from semantic_slam_lab.studies.real_drives.drives import KITTI, Drive
from semantic_slam_lab.studies.real_drives.judged import Judged, judged
from semantic_slam_lab.studies.real_drives.kitti import kitti_metrics
from semantic_slam_lab.studies.real_drives.methods import (
    AS_CONFIGURED,
    BATCH,
    GIVEN,
    WITH_ROBOTS,
    Chosen,
    prepared,
)
from semantic_slam_lab.studies.real_drives.scores import (
    Metrics,
    aligned_error,
    dead_reckoning,
    known,
    map_metrics,
    metrics_of,
    path_metrics,
)
from semantic_slam_lab.studies.victoria_park.methods import StudyPool, smoothed_poses


@dataclass(frozen=True, kw_only=True)
class Task:
    """One method over one drive."""

    drive: Drive
    method: str
    base: Configuration
    chosen: Chosen | None = None  # by ours on this drive; None: it is ours, or ours failed
    max_keyframes: int | None = None


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What came of it; K keyframes, O objects stated, all in the frame of the truth after alignment."""

    metrics: Metrics
    chosen: Chosen | None  # by this run, or given to it; None: neither
    path: Array  # (K, 2)
    true_path: Array  # (K, 2) NaN where not known
    dead_reckoning: Array  # (K, 2)
    objects: Array  # (O, 2)
    true_objects: Array  # (T, 2) those that stand still and were seen
    fault: str = ""  # why there is nothing, or why the run ended early


def outcome_of(task: Task) -> Outcome:
    """Import the drive into a folder that is gone afterwards, run the method, compare with the truth.

    Says nothing on the way: many run side by side, and the study shows how far they are.
    """
    with Path(os.devnull).open("w") as nowhere, redirect_stdout(nowhere), redirect_stderr(nowhere):
        return _outcome_of(task)


def _outcome_of(task: Task) -> Outcome:
    with tempfile.TemporaryDirectory(prefix="real_drives_") as folder:
        bag, beliefs = Path(folder) / "drive", Path(folder) / "beliefs"
        try:
            task.drive.write_bag(bag, with_robots=task.method == WITH_ROBOTS, max_keyframes=task.max_keyframes)
            return _by_batch(task, bag, beliefs) if task.method == BATCH else _by_engine(task, bag, beliefs)
        except SemanticSlamError as error:
            nothing = np.zeros((0, 2))
            return Outcome(
                metrics={},
                chosen=task.chosen,
                path=nothing,
                true_path=nothing,
                dead_reckoning=nothing,
                objects=nothing,
                true_objects=nothing,
                fault=str(error),
            )


def _by_engine(task: Task, bag: Path, beliefs: Path) -> Outcome:
    own = prepared(task.method, task.base, task.chosen)
    configuration, pool, begin = own.configuration, StudyPool(1), time.process_time()
    summary = run_bag(bag, beliefs, configuration, max_keyframes=task.max_keyframes, pool=pool)
    seconds = time.process_time() - begin
    record = read_record(beliefs)
    last = record.beliefs[-1]
    component = pool.component(int(last.hypothesis_ids[np.argmax(last.log_weights)]))
    chosen, run = _chosen(component, configuration), judged(record, smoothed_poses(component)[:, :3])
    metrics: Metrics = {
        **metrics_of(run),
        **_times(record, seconds),
        "odometry_factor": chosen.odometry_factor * own.odometry_factor,
        "detection_factor": chosen.detection_factor,
        "ranges_are_depth": float(chosen.ranges_are == DEPTH),
        "correlated_share": _share(chosen, configuration),
        "num_keyframes": len(record.beliefs),
        "detections_left_out": sum(n for reason, n in summary.dropped.items() if "outside the region" in reason),
    }
    if task.drive.kind == KITTI:
        metrics |= kitti_metrics(run, task.drive.folder, task.drive.name.rpartition("/")[2])
    if task.method == WITH_ROBOTS:
        metrics["robots_called_moving"] = metrics["moving_recall"]
    objects = run.stated.positions[~run.stated.moves]
    return _outcome(run, metrics, chosen, run.path, objects, str(summary.fault or ""))


def _chosen(component: Component, configuration: Configuration) -> Chosen:
    """What the hypothesis takes the noises to be, or what the configuration says."""
    if component.noise_settings is None:
        perception = configuration.perception
        return Chosen(detection_factor=perception.noise_factors[0], ranges_are=perception.ranges_are[0])
    own = component.noise_settings
    kind = DEPTH if own.ranges_are_depth else DISTANCE
    return Chosen(own.odometry_factor, own.detection_factor, kind, own.correlated_share)


def _share(chosen: Chosen, configuration: Configuration) -> float:
    """Share of a detection's variance that repeats."""
    share = chosen.correlated_share
    return configuration.detection_errors.correlated_share if share is None else share


def _by_batch(task: Task, bag: Path, beliefs: Path) -> Outcome:
    """Over the keyframes that ``given`` has; a run with numbers given lists them and the detections in them."""
    configuration = prepared(GIVEN, task.base, task.chosen).configuration
    run_bag(bag, beliefs, configuration, max_keyframes=task.max_keyframes)
    record = read_record(beliefs)
    begin = time.process_time()
    solution = batch.batch_cauchy(record, configuration, (task.chosen or AS_CONFIGURED).detection_factor)
    seconds = time.process_time() - begin
    run = judged(record, solution.path)
    places = np.array(list(solution.landmarks.values())).reshape(-1, 2)
    metrics: Metrics = {
        **path_metrics(run.path, run.true_path),
        "dead_reckoning_ate_aligned_m": aligned_error(dead_reckoning(run), run.true_path),
        "num_objects": len(places),
        "num_true_objects": len({name for name in run.names if name}),
    }
    if run.has_poses and run.seen_fixed:
        seen = np.array(list(run.seen_fixed.values()))
        metrics |= map_metrics(run.aligning.applied(places), seen, list(run.fixed.values()))
    metrics = {name: known(value) for name, value in metrics.items()} | _times(record, seconds)
    return _outcome(run, metrics, task.chosen, solution.path, places, "")


def _times(record: Record, seconds: float) -> Metrics:
    duration_s = (record.beliefs[-1].stamp_ns - record.beliefs[0].stamp_ns) / 1e9
    return {"cpu_s": seconds, "real_time_factor": duration_s / seconds}


def _outcome(run: Judged, metrics: Metrics, chosen: Chosen | None, path: Array, objects: Array, fault: str) -> Outcome:
    aligning = run.aligning
    places = list(run.seen_fixed.values())
    return Outcome(
        metrics=metrics,
        chosen=chosen,
        path=aligning.applied(path[:, :2]),
        true_path=run.true_path[:, :2],
        dead_reckoning=dead_reckoning(run)[:, :2],
        objects=aligning.applied(objects),
        true_objects=np.array(places).reshape(-1, 2),
        fault=fault,
    )
