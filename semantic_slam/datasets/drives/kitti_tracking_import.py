"""``import_dataset kitti_tracking``: detected boxes as places, odometry made of the poses, labels as ground truth."""

import argparse
from itertools import pairwise
from pathlib import Path

import numpy as np

from semantic_slam.datasets.drives import kitti_tracking, kitti_truth
from semantic_slam.datasets.drives.drive import BODY_FRAME, Drive, Path2D, write_drive
from semantic_slam.datasets.drives.kitti_tracking import DetectedBoxes
from semantic_slam.errors import InputError
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages.ground_truth import MOVING
from semantic_slam.perception.frame import Detections

START_NS = 1_000_000_000
"""Stamp of the first picture; zero means "no stamp" to many tools."""
PERIOD_NS = 100_000_000
"""From picture to picture, 10 Hz; the files have frame numbers alone."""
DRIFT = 0.03
"""Standard deviation along and across [m] after a metre; it grows with the root of the distance."""
HEADING_DRIFT_RAD = np.deg2rad(0.5)
"""Standard deviation of the heading after a metre, at :data:`DRIFT`."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of ``import_dataset kitti_tracking``."""
    parser.add_argument("source", type=Path, metavar="SRC", help="folder of {det,label,orb}_NNNN.txt, or .txt.gz")
    parser.add_argument("--drive", required=True, metavar="NNNN", help="number of the drive, such as 0001")
    parser.add_argument("--out", required=True, type=Path, metavar="BAG", help="bag folder to write")
    parser.add_argument(
        "--drift",
        type=float,
        default=DRIFT,
        metavar="M",
        help="noise of the odometry along and across after a metre [m]; heading in proportion (default: %(default)s)",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the odometry's noise (default: 0)")
    parser.add_argument("--max-keyframes", type=int, metavar="N", help="stop after N pictures")


def run(arguments: argparse.Namespace, bag: Path) -> None:
    """Write the bag and say what it holds; raises InputError."""
    if not (arguments.drift >= 0.0 and np.isfinite(arguments.drift)):
        raise InputError(f"--drift {arguments.drift}: must be 0 m or more")
    if arguments.seed < 0:
        raise InputError(f"--seed {arguments.seed}: must be 0 or more")
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


def noisy_odometry(poses: Array, drift: float, rng: np.random.Generator) -> Array:
    """(K, 3) poses in odom of a body that drove ``poses`` (K, 3): a random walk over the distance.

    The error of each step is white, in its tangent space, with variance in proportion to the step's length.
    """
    found = [np.zeros(3)]
    for before, after in pairwise(poses):
        step = se2.between(before, after)
        per_root_metre = np.array([drift, drift, HEADING_DRIFT_RAD * drift / DRIFT])
        sigma = per_root_metre * np.sqrt(np.hypot(step[0], step[1]))
        found.append(se2.compose(found[-1], se2.retract(step, sigma * rng.standard_normal(3))))
    return np.array(found)


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
