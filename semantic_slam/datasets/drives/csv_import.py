"""``import_dataset csv``: odometry and detections in tables of one's own, with the truth where there is any."""

import argparse
from pathlib import Path

import numpy as np

from semantic_slam.datasets.drives.csv_tables import SeenRows, read_detections, read_objects, read_path
from semantic_slam.datasets.drives.drive import Drive, write_drive
from semantic_slam.datasets.drives.tables import found, found_or_none
from semantic_slam.datasets.frames import BODY_FRAME
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Index
from semantic_slam.perception.frame import Detections


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of ``import_dataset csv``."""
    parser.add_argument(
        "source",
        type=Path,
        metavar="SRC",
        help="folder of odometry.csv, detections.csv[, ground_truth.csv, objects.csv]",
    )
    parser.add_argument("--out", required=True, type=Path, metavar="BAG", help="bag folder to write")
    parser.add_argument("--max-keyframes", type=int, metavar="N", help="stop after N frames")


def run(arguments: argparse.Namespace, bag: Path) -> None:
    """Write the bag and say what it holds; raises InputError."""
    written = write_drive(read_drive(arguments.source), bag, "csv", arguments.max_keyframes)
    print(f"{arguments.out}: {written}")


def read_drive(folder: Path) -> Drive:
    """The drive of a folder's tables; detections of one stamp are one frame. Raises InputError."""
    odometry = read_path(found(folder, "odometry.csv"))
    seen = read_detections(found(folder, "detections.csv"))
    truth_file, objects_file = found_or_none(folder, "ground_truth.csv"), found_or_none(folder, "objects.csv")
    if objects_file is not None and truth_file is None:
        raise InputError(f"{objects_file}: in the frame of true poses, which are not there; add ground_truth.csv")
    stamps, starts = np.unique(seen.stamps_ns, return_index=True)
    frames = np.split(np.arange(len(seen.stamps_ns)), starts[1:])
    told = [rows[np.isfinite(seen.places[rows, 0])] for rows in frames]
    kept = list(zip(stamps.tolist(), told, strict=True))
    ids = seen.object_ids
    return Drive(
        odometry=odometry,
        frames=[_detections(seen, rows, stamp) for stamp, rows in kept],
        associations=None if ids is None else [tuple(ids[row] for row in rows) for _, rows in kept],
        truth=None if truth_file is None else read_path(truth_file),
        objects=None if objects_file is None else read_objects(objects_file),
    )


def _detections(seen: SeenRows, rows: Index, stamp_ns: int) -> Detections:
    return Detections(
        stamp_ns=stamp_ns,
        frame_id=BODY_FRAME,
        boxes=np.full((len(rows), 4), np.nan),
        labels=tuple(seen.labels[row] for row in rows),
        scores=seen.scores[rows],
        track_ids=tuple(seen.track_ids[row] for row in rows),
        ranges_m=seen.places[rows, 0],
        bearings_rad=seen.places[rows, 1],
    )
