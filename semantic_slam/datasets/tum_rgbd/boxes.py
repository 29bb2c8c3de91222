"""``detections.csv`` of a folder: a detector's boxes, and of which object each is where that is known."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from semantic_slam.datasets.drives.csv_tables import Row, read_rows
from semantic_slam.datasets.drives.tables import nanoseconds
from semantic_slam.datasets.frames import CAMERA_FRAME
from semantic_slam.datasets.space.drive import PlacedObjects
from semantic_slam.geometry.arrays import Array
from semantic_slam.perception.frame import Detections

SIDES = ("x_min", "y_min", "x_max", "y_max")
COLUMNS, MORE = ("stamp_s", "label", "score", *SIDES), ("object_id",)
OBJECTS, OBJECTS_MORE = ("object_id", "x", "y", "z"), ("class",)
REMEDY = "give finite numbers, x_min < x_max and y_min < y_max in pixels"
SAME_INSTANT_NS = 1_000_000
"""Stamps of a picture and of its boxes that are so near are one, written with fewer digits."""


@dataclass(frozen=True)
class BoxRows:
    """D boxes at stamps that do not run backwards."""

    stamps_ns: NDArray[np.int64]  # (D,)
    labels: tuple[str, ...]  # (D,)
    scores: Array  # (D,)
    boxes: Array  # (D, 4)
    object_ids: tuple[str, ...] | None  # (D,) true ids, "" for none; None: no such column

    def frames(self, pictures_ns: NDArray[np.int64]) -> tuple[list[Detections], list[tuple[str, ...]] | None]:
        """Boxes of one stamp are one frame, and pictures in which nothing was found are frames, too; with true ids."""
        stamps, starts = np.unique(self.stamps_ns, return_index=True)
        rows = dict(zip(stamps.tolist(), np.split(np.arange(len(self.stamps_ns)), starts[1:]), strict=True))
        empty = [stamp for stamp in pictures_ns.tolist() if not _is_near(stamps, stamp)]
        rows |= {stamp: np.array([], dtype=int) for stamp in empty}
        ordered = sorted(rows)
        ids = self.object_ids
        named = None if ids is None else [tuple(ids[row] for row in rows[stamp]) for stamp in ordered]
        return [self._frame(stamp, rows[stamp]) for stamp in ordered], named

    def _frame(self, stamp_ns: int, rows: NDArray[np.int_]) -> Detections:
        return Detections(
            stamp_ns=stamp_ns,
            frame_id=CAMERA_FRAME,
            boxes=self.boxes[rows],
            labels=tuple(self.labels[row] for row in rows),
            scores=self.scores[rows],
            track_ids=("",) * len(rows),
        )


def read_boxes(path: Path) -> BoxRows:
    """All boxes. Raises InputError."""
    rows = read_rows(path, COLUMNS, MORE)
    times: list[float] = []
    values = []
    for row in rows:
        times += row.numbers(("stamp_s",), "give the stamp in seconds")
        if len(times) > 1 and times[-1] < times[-2]:
            raise row.line.fault(f"time goes backwards, from {times[-2]:.6f} to {times[-1]:.6f}", "sort its lines")
        values.append(_values(row))
    told = np.array(values)
    return BoxRows(
        stamps_ns=nanoseconds(np.array(times)),
        labels=tuple(row.fields["label"] for row in rows),
        scores=told[:, 0],
        boxes=told[:, 1:],
        object_ids=tuple(row.fields["object_id"] for row in rows) if "object_id" in rows[0].fields else None,
    )


def read_placed_objects(path: Path) -> PlacedObjects:
    """True objects in the world of the true poses. Raises InputError."""
    rows = read_rows(path, OBJECTS, OBJECTS_MORE)
    return PlacedObjects(
        object_ids=tuple(row.fields["object_id"] for row in rows),
        class_names=tuple(row.fields.get("class", "") for row in rows),
        positions=np.array([row.numbers(OBJECTS[1:], "give x, y and z [m]") for row in rows]),
    )


def _values(row: Row) -> list[float]:
    """Score and sides of a box. Raises InputError."""
    values = row.numbers(("score", *SIDES), REMEDY)
    if not (values[1] < values[3] and values[2] < values[4]):
        raise row.line.fault("a box without an inside", REMEDY)
    return values


def _is_near(stamps: NDArray[np.int64], stamp_ns: int) -> bool:
    row = int(np.searchsorted(stamps, stamp_ns))
    near = stamps[max(row - 1, 0) : row + 1]
    return bool((np.abs(near - stamp_ns) <= SAME_INSTANT_NS).any())
