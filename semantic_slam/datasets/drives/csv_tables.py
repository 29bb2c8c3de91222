"""Comma-separated tables with a header line: odometry, detections and, where it is known, the truth."""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from semantic_slam.datasets.drives.drive import Path2D, TrueObjects
from semantic_slam.datasets.drives.tables import Line, lines_of, numbers
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array

POSES = ("stamp_ns", "x", "y", "yaw")
DETECTIONS, DETECTIONS_MORE = ("stamp_ns", "range_m", "bearing_rad"), ("label", "score", "track_id", "object_id")
OBJECTS, OBJECTS_MORE = ("object_id", "x", "y"), ("class",)


@dataclass(frozen=True)
class Row:
    """One line with its fields by column."""

    line: Line
    fields: dict[str, str]

    def numbers(self, columns: Sequence[str], remedy: str) -> list[float]:
        """The numbers of ``columns``. Raises InputError."""
        words = [self.fields[column] for column in columns]
        return numbers(Line(self.line.path, self.line.number, words), columns, remedy)

    def stamp_ns(self, before: int | None) -> int:
        """The stamp, which must not be less than the one ``before``. Raises InputError."""
        text = self.fields["stamp_ns"]
        if not text.isdecimal():
            raise self.line.fault(f"stamp_ns is '{text}', not a whole number of nanoseconds", "correct it")
        if before is not None and int(text) < before:
            raise self.line.fault(f"time goes backwards, from {before} to {text}", "sort its lines")
        return int(text)


@dataclass(frozen=True)
class SeenRows:
    """D detections in the order of their stamps; NaN in a row that says that at its stamp nothing was detected."""

    stamps_ns: NDArray[np.int64]  # (D,)
    places: Array  # (D, 2) range [m], bearing [rad]
    labels: tuple[str, ...]  # (D,)
    scores: Array  # (D,)
    track_ids: tuple[str, ...]  # (D,)
    object_ids: tuple[str, ...] | None  # (D,) true ids; None: no such column


def read_path(path: Path) -> Path2D:
    """Poses x y yaw at stamps that grow. Raises InputError."""
    stamps: list[int] = []
    poses = []
    for row in read_rows(path, POSES, ()):
        stamp = row.stamp_ns(stamps[-1] if stamps else None)
        if stamps and stamp == stamps[-1]:
            raise row.line.fault(f"stamp {stamp} again", "give one pose per stamp")
        stamps.append(stamp)
        poses.append(row.numbers(POSES[1:], "give x y [m] and yaw [rad]"))
    return Path2D(np.array(stamps, dtype=np.int64), np.array(poses))


def read_detections(path: Path) -> SeenRows:
    """All detections; where range and bearing are both empty, the row stands for a frame in which nothing was seen."""
    rows = read_rows(path, DETECTIONS, DETECTIONS_MORE)
    stamps: list[int] = []
    places, scores = [], []
    for row in rows:
        stamps.append(row.stamp_ns(stamps[-1] if stamps else None))
        nothing = not row.fields["range_m"] and not row.fields["bearing_rad"]
        remedy = "give range and bearing, or leave both empty where nothing was detected"
        places.append([np.nan, np.nan] if nothing else row.numbers(DETECTIONS[1:], remedy))
        scores.append(row.numbers(("score",), "give 0 to 1, or leave it out")[0] if row.fields.get("score") else 1.0)
    texts = {name: tuple(row.fields.get(name, "") for row in rows) for name in DETECTIONS_MORE}
    named = "object_id" in rows[0].fields
    return SeenRows(
        np.array(stamps, dtype=np.int64),
        np.array(places),
        texts["label"],
        np.array(scores),
        texts["track_id"],
        texts["object_id"] if named else None,
    )


def read_objects(path: Path) -> TrueObjects:
    """True objects in the frame of the true poses. Raises InputError."""
    rows = read_rows(path, OBJECTS, OBJECTS_MORE)
    positions = [row.numbers(OBJECTS[1:], "give x and y [m]") for row in rows]
    names = tuple(row.fields["object_id"] for row in rows)
    return TrueObjects(names, tuple(row.fields.get("class", "") for row in rows), np.array(positions))


def read_rows(path: Path, required: tuple[str, ...], optional: tuple[str, ...]) -> list[Row]:
    """All lines after the header, whose columns may be in any order. Raises InputError.

    A first line that begins with a number is no header: then columns are the required ones in their order.
    """
    wanted = f"its first line names the columns {', '.join(required)}"
    wanted += f" and perhaps {', '.join(optional)}" if optional else ""
    header: list[str] | None = None
    rows = []
    for line in lines_of(path, wanted, "\n"):
        words = [word.strip() for word in next(csv.reader(line.words))]
        if header is None and _is_number(words[0]):
            header = list(required)
        if header is None:
            header = words
            missing = [column for column in required if column not in words]
            unknown = [column for column in words if column not in required + optional]
            if missing or unknown:
                fault = f"no column {missing[0]}" if missing else f"unknown column '{unknown[0]}'"
                raise line.fault(fault, wanted)
        elif len(words) != len(header):
            raise line.fault(f"{len(words)} columns, but the first line names {len(header)}", "complete the line")
        else:
            rows.append(Row(line, dict(zip(header, words, strict=True))))
    if not rows:
        raise InputError(f"{path}: no lines after the header; {wanted}")
    return rows


def _is_number(word: str) -> bool:
    return bool(re.fullmatch(r"[-+]?\d+(\.\d*)?", word))
