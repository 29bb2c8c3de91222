"""YOLO's layouts: a single output that is a table with a row for every box."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from semantic_slam.geometry.arrays import Array, Bytes

CELL_SIDES = (8, 16, 32)
"""Pixels of the input that a side of YOLOX's cells has, grid by grid."""
LEAST_SPREAD = 0.5
"""Share of the input over which the centres of all boxes must spread at least: every cell of the input has a box."""


@dataclass(frozen=True)
class YoloTable(ABC):
    """Layout with a single output, (1, N, columns), or (1, columns, N) where it is transposed.

    Input: RGB, 0..1.
    """

    num_classes: int
    size: tuple[int, int]  # height and width of the input, pixels
    is_transposed: bool

    name: ClassVar[str]  # that a user may give
    grey: ClassVar[int] = 114
    usually_transposed: ClassVar[bool] = False
    is_only_named: ClassVar[bool] = False  # not recognised by its shape, which is another layout's, too

    @staticmethod
    @abstractmethod
    def num_columns(num_classes: int) -> int:
        """Length of a row."""

    @classmethod
    def of(
        cls, shape: tuple[int, ...], num_classes: int, size: tuple[int, int], *, in_any_turn: bool
    ) -> "YoloTable | None":
        """Recognise an (A, B) table, turned as this layout's networks have it or in any way; None: it is of another."""
        turns = (cls.usually_transposed, not cls.usually_transposed) if in_any_turn else (cls.usually_transposed,)
        columns = cls.num_columns(num_classes)
        return next((cls(num_classes, size, turn) for turn in turns if shape[0 if turn else 1] == columns), None)

    def normalised(self, pixels: Bytes) -> Array:
        return np.asarray(pixels / 255.0)

    def boxes(self, outputs: Sequence[Array]) -> tuple[Array, Array]:
        table = table_of(outputs)
        return self._read(table.T if self.is_transposed else table)

    @abstractmethod
    def _read(self, table: Array) -> tuple[Array, Array]:
        """Boxes and scores of an (N, columns) table. Raises ValueError for numbers that are not of this layout."""


def table_of(outputs: Sequence[Array]) -> Array:
    """(A, B) table among the outputs; those of other ranks are raw grids, which it repeats."""
    tables: list[Array] = [output[0] for output in outputs if output.ndim == 3]
    (table,) = tables
    return table


class _CentredBoxes(YoloTable, ABC):
    """Boxes by centre and size, in pixels of the input, one at least for every cell."""

    def _corners(self, table: Array) -> Array:
        """(N, 4) x_min y_min x_max y_max of rows that begin with centre and size. Raises ValueError."""
        centres, halves = table[:, :2], table[:, 2:4] / 2.0
        if not _are_in_pixels(centres, self.size):
            raise ValueError("the boxes are not in pixels of the input (those of a YOLOX are read with --layout yolox)")
        return np.concatenate([centres - halves, centres + halves], axis=1)


def _are_in_pixels(centres: Array, size: tuple[int, int]) -> bool:
    """Whether (N, 2) centres spread over an input of that height and width."""
    return bool((np.ptp(centres, axis=0) >= LEAST_SPREAD * np.array(size[::-1])).all())


class WithObjectness(_CentredBoxes):
    """Layout of YOLOv5 and v7: centre, size, objectness, and scores of the classes given that there is an object."""

    name = "yolov5"

    @staticmethod
    def num_columns(num_classes: int) -> int:
        return 5 + num_classes

    def _read(self, table: Array) -> tuple[Array, Array]:
        return self._corners(table), table[:, 4:5] * table[:, 5:]


class WithClassScores(_CentredBoxes):
    """Layout of YOLOv8 and v11: centre, size, and scores of the classes."""

    name = "yolov8"
    usually_transposed = True

    @staticmethod
    def num_columns(num_classes: int) -> int:
        return 4 + num_classes

    def _read(self, table: Array) -> tuple[Array, Array]:
        return self._corners(table), table[:, 4:]


class ByCell(YoloTable):
    """Layout of YOLOX: offset from the cell and log size in cells, objectness, and scores of the classes.

    One row for each cell of grids of 8, 16 and 32 pixels (Ge et al. 2021; ``demo_postprocess`` of its repository), or
    boxes that the file has decoded already. Input: BGR, 0..255.
    """

    name = "yolox"
    is_only_named = True

    @staticmethod
    def num_columns(num_classes: int) -> int:
        return 5 + num_classes

    def normalised(self, pixels: Bytes) -> Array:
        return np.asarray(pixels[..., ::-1], dtype=np.float64)

    def _read(self, table: Array) -> tuple[Array, Array]:
        corners, sides = self._cells()
        if len(table) != len(sides):
            raise ValueError(
                f"it has {len(table)} boxes, not one for each of the {len(sides)} cells of YOLOX's grids; give the"
                " input size of the export, a multiple of 32"
            )
        centres, sizes = table[:, :2], table[:, 2:4]
        if not _are_in_pixels(centres, self.size):
            centres, sizes = (centres + corners) * sides, np.exp(sizes) * sides
        boxes = np.concatenate([centres - sizes / 2.0, centres + sizes / 2.0], axis=1)
        return boxes, table[:, 4:5] * table[:, 5:]

    def _cells(self) -> tuple[Array, Array]:
        """(N, 2) column and row of every cell, row by row, and (N, 1) sides in pixels."""
        height, width = self.size
        grids = [np.indices((height // side, width // side)).reshape(2, -1)[::-1].T for side in CELL_SIDES]
        sides = np.repeat(np.array(CELL_SIDES, dtype=np.float64), [len(grid) for grid in grids])
        return np.concatenate(grids).astype(np.float64), sides[:, None]


class EndToEnd(YoloTable):
    """Layout of YOLOv10 and of exports with suppression: two corners, the best class's score, its number."""

    name = "end_to_end"

    @staticmethod
    def num_columns(num_classes: int) -> int:
        return 6

    def _read(self, table: Array) -> tuple[Array, Array]:
        numbers, scores = table[:, 5], np.full((len(table), self.num_classes + 1), np.nan)
        if (numbers != np.round(numbers)).any():
            raise ValueError("the sixth column holds no numbers of classes")
        rows = np.flatnonzero(numbers >= 0)  # others fill the table up
        scores[rows, np.minimum(numbers[rows], self.num_classes).astype(np.intp)] = table[rows, 4]
        return table[:, :4], scores
