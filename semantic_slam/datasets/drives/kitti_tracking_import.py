"""``import_dataset kitti_tracking``: detected boxes as places, odometry made of the poses, labels as ground truth."""

import argparse
from pathlib import Path

import numpy as np

from semantic_slam.datasets.drives import kitti_tracking, kitti_truth
from semantic_slam.datasets.drives.drive import Drive, Path2D, write_drive
from semantic_slam.datasets.drives.kitti_tracking import DetectedBoxes
from semantic_slam.datasets.drives.noisy_odometry import add_drift, check_drift, noisy_odometry
from semantic_slam.datasets.frames import BODY_FRAME
from semantic_slam.messages.ground_truth import MOVING
from semantic_slam.perception.frame import Detections

START_NS = 1_000_000_000
"""Stamp of the first picture; zero means "no stamp" to many tools."""
PERIOD_NS = 100_000_000
"""From picture to picture, 10 Hz; the files have frame numbers alone."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of ``import_dataset kitti_tracking``."""
    parser.add_argument("source", type=Path, metavar="SRC", help="folder of {det,label,orb}_NNNN.txt, or .txt.gz")
    parser.add_argument("--drive", required=True, metavar="NNNN", help="number of the drive, such as 0001")
    parser.add_argument("--out", required=True, type=Path, metavar="BAG", help="bag folder to write")
    add_drift(parser)
    parser.add_argument("--max-keyframes", type=int, metavar="N", help="stop after N pictures")


def run(arguments: argparse.Namespace, bag: Path) -> None:
    """Write the bag and say what it holds; raises InputError."""
    check_drift(arguments)
    drive = read_drive(arguments.source, arguments.drive, arguments.drift, arguments.seed)
    written = write_drive(drive, bag, arguments.drive, arguments.max_keyframes)
    print(f"{arguments.out}: {written}")
    if drive.objects is not None and drive.associations is not None:
        moving = sum(name.startswith(MOVING) for name in drive.objects.object_ids)
        labelled = sum(bool(name) for names in drive.associations for name in names)
        known = f"{len(drive.objects.object_ids)} objects with {kitti_truth.LEAST_VIEWS} labelled views or more"
        print(f"whole drive: {known}, of which {moving} move; {labelled} detections of labelled objects")
        metre = _metre(arguments.source, arguments.drive)
        print(
            f"the given poses have another metre than the labels: what is parked stands still at {metre:.3f} of theirs"
        )
    print(f"stamps are made up: 10 Hz; odometry: the poses' increments with noise (--drift {arguments.drift:g})")


def _metre(folder: Path, name: str) -> float:
    """Length of the labels' metre in that of the poses."""
    poses = kitti_tracking.read_poses(folder, name)
    labels = kitti_tracking.read_labelled(folder, name, len(poses))
    return 1.0 if labels is None else kitti_truth.metre_of(labels, poses)


def read_drive(folder: Path, name: str, drift: float, seed: int) -> Drive:
    """One drive with one frame per pose, also where nothing was detected. Raises InputError."""
    poses = kitti_tracking.read_poses(folder, name)
    detected = kitti_tracking.read_detected(folder, name, len(poses))
    labels = kitti_tracking.read_labelled(folder, name, len(poses))
    stamps_ns = START_NS + PERIOD_NS * np.arange(len(poses), dtype=np.int64)
    rng = np.random.default_rng([seed, *name.encode()])
    objects, associations = None, None
    if labels is not None:
        tracks = kitti_truth.tracks_of(labels, poses)
        objects = kitti_truth.true_objects(tracks)
        associations = kitti_truth.associations(detected, labels, tracks, len(poses))
    return Drive(
        odometry=Path2D(stamps_ns, noisy_odometry(poses, drift, rng)),
        frames=[_detections(detected, frame, stamp) for frame, stamp in enumerate(stamps_ns.tolist())],
        associations=associations,
        truth=Path2D(stamps_ns, poses),
        objects=objects,
    )


def _detections(detected: DetectedBoxes, frame: int, stamp_ns: int) -> Detections:
    rows = np.flatnonzero(detected.frames == frame)
    return Detections(
        stamp_ns=stamp_ns,
        frame_id=BODY_FRAME,
        boxes=detected.boxes[rows],
        labels=tuple(detected.types[row] for row in rows),
        scores=detected.scores[rows],
        track_ids=("",) * len(rows),
        positions=detected.centres[rows],
        position_covariances=detected.covariances[rows],
    )
