"""``import_dataset g2o``: the odometry and sightings of a landmark graph, landmark numbers as ground truth."""

import argparse
from pathlib import Path

import numpy as np

from semantic_slam.datasets.drives.drive import Drive, Path2D, write_drive
from semantic_slam.datasets.drives.g2o import LandmarkGraph, Sighting, read_graph
from semantic_slam.datasets.frames import BODY_FRAME
from semantic_slam.errors import InputError
from semantic_slam.geometry import se2
from semantic_slam.perception.frame import Detections

START_NS = 1_000_000_000
"""Stamp of the first pose; zero means "no stamp" to many tools."""
PERIOD_S = 0.2224
"""From pose to pose; the DLR drive of 3297 poses then takes the 733 s that it took."""
LABEL = "landmark"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of ``import_dataset g2o``."""
    parser.add_argument("source", type=Path, metavar="FILE", help="landmark graph, .g2o or .g2o.gz")
    parser.add_argument("--out", required=True, type=Path, metavar="BAG", help="bag folder to write")
    parser.add_argument(
        "--period",
        type=float,
        default=PERIOD_S,
        metavar="S",
        help="time from pose to pose, which the format does not hold [s] (default: %(default)s)",
    )
    parser.add_argument("--max-keyframes", type=int, metavar="N", help="stop after N poses")


def run(arguments: argparse.Namespace, bag: Path) -> None:
    """Write the bag and say what it holds, which stamps are made up and what was left out; raises InputError."""
    if not arguments.period > 0.0:
        raise InputError(f"--period {arguments.period}: must be greater than 0 s")
    graph = read_graph(arguments.source)
    written = write_drive(drive_of(graph, arguments.period), bag, "g2o", arguments.max_keyframes)
    landmarks = {sighting.landmark for seen in graph.sightings for sighting in seen}
    print(f"{arguments.out}: {written}; {len(landmarks)} landmark numbers in the file (ground truth only)")
    print(f"stamps are made up: the file has none; {arguments.period:g} s from pose to pose, {written.seconds:.1f} s")
    for name, number in sorted(graph.left_out.items()):
        print(f"left out: {number} {name}")


def drive_of(graph: LandmarkGraph, period_s: float) -> Drive:
    """The drive at stamps ``period_s`` apart; every pose is a frame, also one from which nothing was seen."""
    poses = se2.wrapped(np.concatenate([np.zeros((1, 3)), se2.along(np.zeros(3), graph.increments)]))
    stamps_ns = START_NS + np.round(np.arange(len(poses)) * period_s * 1e9).astype(np.int64)
    return Drive(
        odometry=Path2D(stamps_ns, poses),
        frames=[_detections(seen, stamp) for seen, stamp in zip(graph.sightings, stamps_ns.tolist(), strict=True)],
        associations=[tuple(str(sighting.landmark) for sighting in seen) for seen in graph.sightings],
    )


def _detections(seen: list[Sighting], stamp_ns: int) -> Detections:
    """Positions in the plane of the body, as sure in height as the graph is: without any error."""
    positions, covariances = np.zeros((len(seen), 3)), np.zeros((len(seen), 3, 3))
    for row, sighting in enumerate(seen):
        positions[row, :2], covariances[row, :2, :2] = sighting.position, sighting.covariance
    return Detections(
        stamp_ns=stamp_ns,
        frame_id=BODY_FRAME,
        boxes=np.full((len(seen), 4), np.nan),
        labels=(LABEL,) * len(seen),
        scores=np.ones(len(seen)),
        track_ids=("",) * len(seen),
        positions=positions,
        position_covariances=covariances,
    )
