"""One start of a lost robot: run until enough was detected, and compare with the truth."""

import os
import tempfile
import time
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.datasets.drives.drive import write_drive
from semantic_slam.errors import InputError
from semantic_slam.evaluation import trajectory
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.evaluation.clusters import clusters_of
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_pose_vector
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import Candidates
from semantic_slam.pipeline.offline import run_bag
from semantic_slam_lab.studies.lost_robot.starts import Start
from semantic_slam_lab.studies.real_drives.judged import Judged, judged
from semantic_slam_lab.studies.real_drives.scores import CLUSTER_M, Metrics, aligned_error, known
from semantic_slam_lab.studies.victoria_park.methods import StudyPool, smoothed_poses

ENOUGH = "enough was detected"
READ_FOR_EACH = 20
"""Detections written to the bag for each that is run."""
NEWEST = 20
"""Detections at the end by which it is told whether a robot knows where it is."""
PLACED_SIGMA_M = 1.0
"""Standard deviation of the position up to which a hypothesis says where the robot is."""
WRONG_M = 1.0
"""From there on it says it wrongly."""


class LimitedPool(StudyPool):
    """One backend, until so many detections were made; keeps the processor time of every keyframe."""

    def __init__(self, most_detections: int) -> None:
        super().__init__(1)
        self._left = most_detections
        self._begun_s: list[float] = []

    def expand(self, keyframe: Keyframe) -> list[Candidates]:
        """Round one. Raises InputError once there were enough detections."""
        self._begun_s.append(time.process_time())
        if self._left <= 0:
            raise InputError(ENOUGH)
        self._left -= len(keyframe.measurements.detection_ids)
        return super().expand(keyframe)

    @property
    def seconds(self) -> Array:
        """(K,) processor time from one keyframe to the next."""
        return np.diff(self._begun_s)


@dataclass(frozen=True, kw_only=True)
class Task:
    """One start."""

    start: Start
    base: Configuration
    seed: int
    most_detections: int


def metrics_of(task: Task) -> Metrics:
    """What came of it; says nothing on the way."""
    with (
        Path(os.devnull).open("w") as nowhere,
        redirect_stdout(nowhere),
        redirect_stderr(nowhere),
        tempfile.TemporaryDirectory(prefix="lost_robot_") as folder,
    ):
        bag, beliefs, pool = Path(folder) / "drive", Path(folder) / "beliefs", LimitedPool(task.most_detections)
        write_drive(task.start.drive, bag, task.start.name, _enough_frames(task))
        run_bag(bag, beliefs, task.start.configuration(task.base, task.seed), task.start.prior, pool=pool)
        record = read_record(beliefs)
        last = record.beliefs[-1]
        component = pool.component(int(last.hypothesis_ids[np.argmax(last.log_weights)]))
        run = judged(record, smoothed_poses(component)[:, :3])
        return {name: known(value) for name, value in _metrics(run, task.start, pool.seconds).items()}


def _enough_frames(task: Task) -> int:
    """Frames of the drive in which there are far more detections than are run: most lie between keyframes."""
    count = np.cumsum([len(frame) for frame in task.start.drive.frames])
    return int(np.searchsorted(count, READ_FOR_EACH * task.most_detections)) + 1


def _metrics(run: Judged, start: Start, seconds: Array) -> Metrics:
    pairs = list(zip(run.record.beliefs, run.true_path, strict=True))
    right = np.array([_weight(belief, pose, wrong=False) for belief, pose in pairs])
    wrong = np.array([_weight(belief, pose, wrong=True) for belief, pose in pairs])
    count = np.cumsum([len(belief.detection_ids) for belief, _ in pairs])
    sure = np.flatnonzero(right > 0.9)
    stamps = [belief.stamp_ns for belief, _ in pairs]
    return {
        "right_clusters": _right_clusters(run, start),
        "ate_m": trajectory.absolute_trajectory_error(run.path[:, :2], run.true_path[:, :2]),
        "ate_aligned_m": aligned_error(run.path, run.true_path),
        "right_probability": float(right[-1]),
        "wrong_probability": float(wrong[-1]),
        "most_wrong_probability": float(wrong.max()),
        "sure_after_detections": int(count[sure[0]]) if len(sure) else None,
        "num_detections": int(count[-1]),
        "num_keyframes": len(pairs),
        "duration_s": (stamps[-1] - stamps[0]) / 1e9,
        "cpu_p95_s": float(np.percentile(seconds, 95)),
        "cpu_max_s": float(seconds.max()),
    }


def _weight(belief: HybridBelief, true_pose: Array, *, wrong: bool) -> float:
    """Weight of the hypotheses that say where the robot is, and are wrong, or right."""
    variance = belief.pose_covariances[:, 0, 0] + belief.pose_covariances[:, 1, 1]
    away = np.hypot(*(planar_from_pose_vector(belief.poses)[:, :2] - true_pose[:2]).T)
    placed = variance < 2.0 * PLACED_SIGMA_M**2
    return float(np.exp(belief.log_weights)[placed & ((away > WRONG_M) == wrong)].sum())


def _right_clusters(run: Judged, start: Start) -> float:
    """Share of the newest detections of landmarks that the best hypothesis has of one of the right cluster."""
    places = np.array([item.pose[:2] for item in start.prior.objects])
    clusters = clusters_of(places, CLUSTER_M).tolist()
    of_name = {item.name: cluster for item, cluster in zip(start.prior.objects, clusters, strict=True)}
    of_object = {item.object_id: cluster for item, cluster in zip(start.prior.objects, clusters, strict=True)}
    pairs = [(of_name[name], of_object.get(n)) for name, n in zip(run.names, run.estimate, strict=True) if name]
    return float(np.mean([true == stated for true, stated in pairs[-NEWEST:]]))
