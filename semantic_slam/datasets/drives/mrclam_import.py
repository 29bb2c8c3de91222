"""``import_dataset mrclam``: one robot's odometry and what its camera read, barcodes as track ids and ground truth."""

import argparse
from collections import Counter
from pathlib import Path

import numpy as np

from semantic_slam.datasets.drives import mrclam
from semantic_slam.datasets.drives.drive import Drive, TrueObjects, since, write_drive
from semantic_slam.datasets.drives.mrclam import NUM_ROBOTS, Readings
from semantic_slam.datasets.frames import BODY_FRAME
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Index
from semantic_slam.messages.ground_truth import MOVING
from semantic_slam.perception.frame import Detections

LANDMARK, ROBOT = "landmark", "robot"
"""What a detector of both would call them: which of them a thing is, its number alone tells."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of ``import_dataset mrclam``."""
    parser.add_argument(
        "source",
        type=Path,
        metavar="SRC",
        help="folder of RobotN_{Odometry,Measurement,Groundtruth}.dat, Barcodes.dat, Landmark_Groundtruth.dat, or .gz",
    )
    parser.add_argument(
        "--robot", type=int, required=True, metavar="N", choices=range(1, NUM_ROBOTS + 1), help="1 to 5"
    )
    parser.add_argument("--out", required=True, type=Path, metavar="BAG", help="bag folder to write")
    parser.add_argument("--robots", action="store_true", help="keep the sightings of other robots, which move")
    parser.add_argument(
        "--from-s", type=float, default=0.0, metavar="S", help="begin S seconds after the odometry does"
    )
    parser.add_argument("--max-keyframes", type=int, metavar="N", help="stop after N frames")


def run(arguments: argparse.Namespace, bag: Path) -> None:
    """Write the bag and say what it holds and what was left out; raises InputError."""
    drive, counts = read_drive(arguments.source, arguments.robot, with_robots=arguments.robots)
    if arguments.from_s > 0.0:
        drive = since(drive, int(drive.odometry.stamps_ns[0]) + round(arguments.from_s * 1e9))
    if not drive.frames:
        raise InputError(f"{arguments.source}: nothing is read after --from-s {arguments.from_s}; give an earlier time")
    written = write_drive(drive, bag, f"robot {arguments.robot}", arguments.max_keyframes)
    print(f"{arguments.out}: {written}")
    print("whole drive: " + ", ".join(f"{number} {name}" for name, number in counts.items()))


def read_drive(folder: Path, robot: int, *, with_robots: bool) -> tuple[Drive, dict[str, int]]:
    """One robot's drive, and how many readings of what its files hold. Raises InputError.

    A frame is all that was read in one picture. Pictures in which nothing was read are not in the files, and none are
    made up; a picture that shows other robots alone stays as an empty frame where these are left out.
    """
    subjects = mrclam.read_barcodes(folder)
    barcode_of = {subject: barcode for barcode, subject in subjects.items()}
    odometry, readings = mrclam.read_odometry(folder, robot), mrclam.read_readings(folder, robot)
    names = [_true_id(int(barcode), subjects) for barcode in readings.barcodes]
    keep = np.array([with_robots or not name.startswith(MOVING) for name in names], dtype=np.bool_)
    frames, associations = [], []
    for rows in readings.frames():
        kept = np.flatnonzero(keep[rows]) + rows.start
        labels = tuple(ROBOT if names[row].startswith(MOVING) else LANDMARK for row in kept)
        frames.append(_detections(readings, kept, labels, int(readings.stamps_ns[rows.start])))
        associations.append(tuple(names[row] for row in kept))
    truth, objects = mrclam.read_truth(folder, robot), mrclam.read_landmarks(folder, barcode_of)
    if with_robots and objects is not None:
        others = mrclam.read_other_robots(folder, robot, barcode_of, int(odometry.stamps_ns[0]))
        objects = _joined(objects, others)
    drive = Drive(odometry=odometry, frames=frames, associations=associations, truth=truth, objects=objects)
    return drive, _counts(names, with_robots)


def _true_id(barcode: int, subjects: dict[int, int]) -> str:
    """The barcode itself, marked where it is a robot's; "" of one that nobody carries."""
    if barcode not in subjects:
        return ""
    return f"{MOVING}{barcode}" if subjects[barcode] <= NUM_ROBOTS else str(barcode)


def _detections(readings: Readings, rows: Index, labels: tuple[str, ...], stamp_ns: int) -> Detections:
    return Detections(
        stamp_ns=stamp_ns,
        frame_id=BODY_FRAME,
        boxes=np.full((len(rows), 4), np.nan),
        labels=labels,
        scores=np.ones(len(rows)),
        track_ids=tuple(str(readings.barcodes[row]) for row in rows),
        ranges_m=readings.ranges_m[rows],
        bearings_rad=readings.bearings_rad[rows],
    )


def _joined(first: TrueObjects, second: TrueObjects) -> TrueObjects:
    return TrueObjects(
        first.object_ids + second.object_ids,
        first.class_names + second.class_names,
        np.concatenate([first.positions, second.positions]),
    )


def _counts(names: list[str], with_robots: bool) -> dict[str, int]:
    kinds = Counter(ROBOT if name.startswith(MOVING) else LANDMARK if name else "none" for name in names)
    return {
        "readings of landmarks": kinds[LANDMARK],
        f"of other robots ({'kept' if with_robots else 'left out'})": kinds[ROBOT],
        "of barcodes that nobody carries (kept)": kinds["none"],
    }
