"""What KITTI's labels tell of a run besides the ids of objects: regions nobody labelled, labels near a detection."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from semantic_slam.datasets.drives.kitti_tracking import (
    NOT_AN_OBJECT,
    REMEDY,
    read_detected,
    read_labelled,
    read_poses,
)
from semantic_slam.datasets.drives.kitti_tracking_import import PERIOD_NS, START_NS
from semantic_slam.datasets.drives.kitti_truth import metre_of, tracks_of
from semantic_slam.datasets.drives.tables import found, lines_of
from semantic_slam.evaluation.association import CLUTTER
from semantic_slam.evaluation.pairs import pair_calibration
from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.messages.ground_truth import MOVING
from semantic_slam_lab.studies.real_drives.judged import Judged, votes
from semantic_slam_lab.studies.real_drives.scores import aligned_error, dead_reckoning, moving_recall

NEAR_M = 1.5
PARKED = ("Car", "Van")
INSIDE_SHARE = 0.5
"""Share of a detected box's area, from which on it lies in a region that nobody labelled."""


@dataclass(frozen=True)
class Beside:
    """N detections beside the labels of their frames."""

    near_label: Flags  # (N,) a label, of whatever type, lies within 1.5 m
    ignored: Flags  # (N,) in a region that nobody labelled, or farther than every label of the drive


def kitti_metrics(run: Judged, folder: Path, drive: str) -> dict[str, float | int | None]:
    """Objects, ghosts and parked cars as the labels have them. Raises InputError."""
    beside = beside_labels(run, folder, drive)
    still = run.stated.ids[~run.stated.moves].tolist()
    num_objects, ghosts = counted(still, run.estimate, beside)
    found: dict[str, float | int | None] = {"num_objects": num_objects, "ghosts": ghosts, "parked_recall": None}
    found |= metrics_in_labels_metre(run, folder, drive) | pairs_of_labelled(run)
    objects = run.truth.objects
    if objects is None:
        return found
    rows = zip(objects.object_ids, objects.class_names, strict=True)
    parked = {name for name, kind in rows if kind in PARKED and not name.startswith(MOVING)}
    standing_for = votes(run.names, run.estimate)
    seen = {standing_for.get(int(number)) for number in still}
    return found | {"parked_recall": len(parked & seen) / len(parked) if parked else None, "num_parked": len(parked)}


def pairs_of_labelled(run: Judged) -> dict[str, float | int | None]:
    """Calibration of pairs of detections that both have a label: whether others are of one thing nobody knows."""
    numbers = run.numbers()
    labelled = numbers > CLUTTER
    pairs = pair_calibration(run.weights, run.objects[:, labelled], numbers[labelled].tolist())
    return {"labelled_pair_right_at_90": pairs.right_at_90, "labelled_pair_ece": pairs.ece_of_stated}


def metrics_in_labels_metre(run: Judged, folder: Path, drive: str) -> dict[str, float | int | None]:
    """Metrics against the given poses in the metre of the labels, which is not theirs. Raises InputError."""
    poses = read_poses(folder, drive)
    labels = read_labelled(folder, drive, len(poses))
    if labels is None:
        return {}
    metre = metre_of(labels, poses)
    scale = np.array([metre, metre, 1.0])
    moving = {track.object_id for track in tracks_of(labels, poses * scale).values()}
    names = [name if name in moving else name.removeprefix(MOVING) for name in run.names]
    return {
        "metre_of_labels": metre,
        "ate_in_labels_metre_m": aligned_error(run.path, run.true_path * scale),
        "dead_reckoning_ate_in_labels_metre_m": aligned_error(dead_reckoning(run), run.true_path * scale),
        "moving_recall_in_labels_metre": moving_recall(names, run),
    }


def counted(objects: Sequence[int], estimate: Sequence[int], beside: Beside) -> tuple[int, int]:
    """Number of ``objects`` that the labels can judge, and how many of them have no label near any detection.

    ``estimate`` (N,) object of every detection. An object whose detections are all to be ignored is not counted.
    """
    of_each = np.asarray(estimate)
    judgeable = {int(n) for n in of_each[~beside.ignored]}
    labelled = {int(n) for n in of_each[~beside.ignored & beside.near_label]}
    own = judgeable & set(objects)
    return len(own), len(own - labelled)


def beside_labels(run: Judged, folder: Path, drive: str) -> Beside:
    """The detections of a run beside the labels. Raises InputError."""
    num_frames = len(read_poses(folder, drive))
    detected, labels = read_detected(folder, drive, num_frames), read_labelled(folder, drive, num_frames)
    count = len(run.names)
    near, ignored = np.zeros(count, dtype=np.bool_), np.ones(count, dtype=np.bool_)
    if labels is None:
        return Beside(near, ignored)
    regions = unlabelled_regions(folder, drive)
    farthest = float(np.linalg.norm(labels.centres[:, :2], axis=1).max(initial=0.0))
    for keyframe in np.unique(run.keyframes):
        own = np.flatnonzero(run.keyframes == keyframe)
        frame = round((run.record.beliefs[keyframe].stamp_ns - START_NS) / PERIOD_NS)
        rows = np.flatnonzero(detected.frames == frame)[run.detection_ids[own]]
        centres, true = detected.centres[rows], labels.centres[labels.frames == frame]
        near[own] = np.linalg.norm(centres[:, None] - true[None], axis=2).min(axis=1, initial=np.inf) <= NEAR_M
        beyond = np.linalg.norm(centres[:, :2], axis=1) > farthest
        ignored[own] = beyond | inside(detected.boxes[rows], regions.get(frame, np.zeros((0, 4))))
    return Beside(near, ignored)


def unlabelled_regions(folder: Path, drive: str) -> dict[int, Array]:
    """Frame -> (R, 4) boxes in pixels within which nobody labelled anything. Raises InputError."""
    regions: dict[int, list[list[float]]] = {}
    for line in lines_of(found(folder, f"label_{drive}.txt"), REMEDY):
        if line.words[2] == NOT_AN_OBJECT:
            regions.setdefault(int(line.words[0]), []).append([float(word) for word in line.words[6:10]])
    return {frame: np.array(boxes) for frame, boxes in regions.items()}


def inside(boxes: Array, regions: Array) -> Flags:
    """(N,) whether at least half of the area of each of (N, 4) boxes lies in one of (R, 4) regions."""
    low = np.maximum(boxes[:, None, :2], regions[None, :, :2])
    high = np.minimum(boxes[:, None, 2:], regions[None, :, 2:])
    common = np.maximum(high - low, 0.0).prod(axis=2)
    area = (boxes[:, 2:] - boxes[:, :2]).prod(axis=1)
    return np.asarray(common.max(axis=1, initial=0.0) >= INSIDE_SHARE * np.maximum(area, 1e-9))
