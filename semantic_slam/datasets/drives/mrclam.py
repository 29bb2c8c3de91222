"""The files of one robot of the UTIAS multi-robot cooperative localisation and mapping data set (MRCLAM).

Leung, Halpern, Barfoot, Liu: "The UTIAS multi-robot cooperative localization and mapping dataset", IJRR 30 (8), 2011.
Times in seconds, metres, radians. Subjects 1 to 5 are robots, the others landmarks. Measurement files hold barcodes,
although their header says subject numbers.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from semantic_slam.datasets.drives.drive import Path2D, TrueObjects
from semantic_slam.datasets.drives.tables import found, found_or_none, nanoseconds, table
from semantic_slam.datasets.drives.velocities import integrated
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages.ground_truth import MOVING

REMEDY = "name a folder of MRCLAM with whole files"
NUM_ROBOTS = 5
FRAME_S = 0.01
"""Readings of one picture are written within 3 ms, pictures are 0.23 s apart."""


@dataclass(frozen=True)
class Readings:
    """R readings of barcodes, at times that do not run backwards."""

    stamps_ns: NDArray[np.int64]  # (R,)
    barcodes: NDArray[np.int64]  # (R,)
    ranges_m: Array  # (R,)
    bearings_rad: Array  # (R,)

    def frames(self) -> list[slice]:
        """Which readings come from one picture: those within :data:`FRAME_S` of the first."""
        starts: list[int] = []
        for row, stamp_ns in enumerate(self.stamps_ns):
            if not starts or stamp_ns - self.stamps_ns[starts[-1]] > FRAME_S * 1e9:
                starts.append(row)
        return [slice(start, end) for start, end in zip(starts, [*starts[1:], len(self.stamps_ns)], strict=True)]


def read_barcodes(folder: Path) -> dict[int, int]:
    """Barcode -> subject. Raises InputError, also where a barcode stands for two subjects."""
    path = found(folder, "Barcodes.dat")
    subjects: dict[int, int] = {}
    for subject, barcode in table(path, ("subject", "barcode"), REMEDY, time=False).astype(int).tolist():
        if barcode in subjects:
            raise InputError(f"{path}: barcode {barcode} is of subjects {subjects[barcode]} and {subject}; correct one")
        subjects[barcode] = subject
    return subjects


def read_odometry(folder: Path, robot: int) -> Path2D:
    """Velocities integrated from the origin; of several at one time the last one holds. Raises InputError."""
    rows = table(found(folder, f"Robot{robot}_Odometry.dat"), ("time", "velocity", "angular velocity"), REMEDY)
    rows = _last_of_each_time(rows)
    return Path2D(nanoseconds(rows[:, 0]), integrated(rows[:, 0] - rows[0, 0], rows[:, 1], rows[:, 2]))


def read_readings(folder: Path, robot: int) -> Readings:
    """What the robot's camera read. Raises InputError."""
    path = found(folder, f"Robot{robot}_Measurement.dat")
    rows = table(path, ("time", "barcode", "range", "bearing"), REMEDY)
    return Readings(nanoseconds(rows[:, 0]), rows[:, 1].astype(np.int64), rows[:, 2], rows[:, 3])


def read_truth(folder: Path, robot: int) -> Path2D | None:
    """Motion capture of a robot; None where there is no file of it. Raises InputError."""
    path = found_or_none(folder, f"Robot{robot}_Groundtruth.dat")
    if path is None:
        return None
    rows = _last_of_each_time(table(path, ("time", "x", "y", "orientation"), REMEDY))
    return Path2D(nanoseconds(rows[:, 0]), rows[:, 1:4])


def read_landmarks(folder: Path, barcode_of: dict[int, int]) -> TrueObjects | None:
    """Surveyed landmarks, named by their barcodes; None where there is no file of them. Raises InputError."""
    path = found_or_none(folder, "Landmark_Groundtruth.dat")
    if path is None:
        return None
    rows = table(path, ("subject", "x", "y"), REMEDY, time=False)
    unknown = [int(subject) for subject in rows[:, 0] if int(subject) not in barcode_of]
    if unknown:
        raise InputError(f"{path}: subject {unknown[0]} has no barcode; complete Barcodes.dat")
    names = tuple(str(barcode_of[int(subject)]) for subject in rows[:, 0])
    return TrueObjects(names, ("landmark",) * len(names), rows[:, 1:3])


def read_other_robots(folder: Path, robot: int, barcode_of: dict[int, int], stamp_ns: int) -> TrueObjects:
    """The other robots that have ground truth, where they were at a time. Raises InputError."""
    names, positions = [], []
    for other in range(1, NUM_ROBOTS + 1):
        truth = read_truth(folder, other) if other != robot and other in barcode_of else None
        if truth is not None:
            names.append(f"{MOVING}{barcode_of[other]}")
            positions.append(truth.since(stamp_ns).poses[0, :2])
    return TrueObjects(tuple(names), ("robot",) * len(names), np.array(positions).reshape(-1, 2))


def _last_of_each_time(rows: Array) -> Array:
    return np.asarray(rows[np.append(np.diff(rows[:, 0]) > 0.0, True)])
