"""``import_dataset victoria_park``: odometry and trunks as a bag, landmark numbers as ground truth."""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from semantic_slam.bag.writer import BagWriter
from semantic_slam.datasets.frames import BODY_FRAME
from semantic_slam.datasets.victoria_park import (
    Log,
    Observation,
    dead_reckoning,
    example_path,
    range_bearing,
    read_log,
    stamps,
)
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import pose_vector_from_planar
from semantic_slam.messages import topics
from semantic_slam.messages.codec import to_message
from semantic_slam.messages.ground_truth import GroundTruthAssociations
from semantic_slam.messages.standard import OdometryEstimate
from semantic_slam.perception.measurement import SemanticMeasurements

LABEL = "tree_trunk"


@dataclass(frozen=True)
class Written:
    """What the bag holds."""

    poses: int
    frames: int  # with at least one detection
    detections: int
    landmarks: int


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of ``import_dataset victoria_park``."""
    parser.add_argument("source", nargs="?", type=Path, metavar="SRC", help="victoria_park.txt (default: gtsam's)")
    parser.add_argument("--out", required=True, type=Path, metavar="BAG", help="bag folder to write")
    parser.add_argument("--max-keyframes", type=int, metavar="N", help="stop after N frames with detections")
    parser.add_argument(
        "--landmark-variance",
        type=float,
        default=0.4,
        metavar="M2",
        help="variance of a trunk's position in each axis [m^2] (default: 0.4, as the file states)",
    )


def run(arguments: argparse.Namespace, bag: Path) -> None:
    """Write the bag and say what it holds; raises InputError."""
    if not arguments.landmark_variance > 0.0:
        raise InputError(f"--landmark-variance {arguments.landmark_variance}: must be greater than 0 m^2")
    log = read_log(arguments.source or example_path())
    written = write_bag(log, bag, arguments.landmark_variance, arguments.max_keyframes)
    print(
        f"{arguments.out}: {written.poses} poses, {written.frames} frames with {written.detections} detections"
        f" of {written.landmarks} landmark numbers (ground truth only)"
    )


def write_bag(log: Log, out: Path, variance_m2: float, max_keyframes: int | None = None) -> Written:
    """Write the drive, or its part up to the ``max_keyframes``-th frame with detections."""
    poses = pose_vector_from_planar(dead_reckoning(log.increments))
    stamps_ns = stamps(log.num_poses)
    used: list[Observation] = []
    frames = 0
    with BagWriter(out) as bag:
        for index, seen in enumerate(tqdm(log.by_pose(), desc="victoria_park", unit="pose")):
            stamp_ns = int(stamps_ns[index])
            bag.write(topics.ODOMETRY, to_message(odometry(poses[index], stamp_ns)), stamp_ns)
            if not seen:
                continue
            positions = np.array([observation.position for observation in seen])
            bag.write(topics.MEASUREMENTS, to_message(measurements(positions, stamp_ns, frames, variance_m2)), stamp_ns)
            truth = GroundTruthAssociations(stamp_ns, tuple(observation.landmark for observation in seen))
            bag.write(topics.GROUND_TRUTH_ASSOCIATIONS, to_message(truth), stamp_ns)
            used += seen
            frames += 1
            if frames == max_keyframes:
                break
    return Written(index + 1, frames, len(used), len({observation.landmark for observation in used}))


def odometry(pose: Array, stamp_ns: int) -> OdometryEstimate:
    """Integrated odometry; covariance zero, unknown: the file's is far too small (config/victoria_park.yaml)."""
    return OdometryEstimate(stamp_ns, "odom", BODY_FRAME, pose, np.zeros((6, 6)))


def measurements(positions: Array, stamp_ns: int, sequence: int, variance_m2: float) -> SemanticMeasurements:
    """Purely geometric measurements of one frame, (D, 2) positions: no classes, no images, no identities."""
    count = len(positions)
    ranges, bearings, covariances = range_bearing(positions, variance_m2)
    return SemanticMeasurements(
        stamp_ns=stamp_ns,
        sequence=sequence,
        frame_id=BODY_FRAME,
        class_names=(),
        detection_ids=np.arange(count, dtype=np.uint32),
        boxes=np.full((count, 4), np.nan),
        labels=(LABEL,) * count,
        scores=np.ones(count),
        track_ids=("",) * count,
        class_probability_samples=np.zeros((count, 0, 0)),
        features=np.zeros((count, 0)),
        feature_covariances=np.zeros((count, 0, 0)),
        predictive_entropy=np.full(count, np.nan),
        mutual_information=np.full(count, np.nan),
        ranges_m=ranges,
        bearings_rad=bearings,
        geometric_covariances=covariances,
        sensor_position=np.zeros(3),
        in_coverage=np.ones(count, dtype=np.bool_),
    )
