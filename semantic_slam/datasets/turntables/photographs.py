"""Photographs of objects from known directions: those of a folder by a pattern of their paths, or those of a table."""

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from semantic_slam.datasets.turntables.pattern import PathPattern
from semantic_slam.datasets.turntables.plain_background import object_mask
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Bytes, Flags
from semantic_slam.messages.picture_files import read_picture

REQUIRED, OPTIONAL = ("file", "object", "azimuth_deg"), ("elevation_deg", "range_m", "mask")
"""Columns of a table of photographs; paths are relative to the table's folder."""
RANGE_M = 1.0
"""Range of photographs that are cut to the object, which nothing tells."""


@dataclass(frozen=True)
class Photograph:
    """One picture of an object; pixels are read when asked for."""

    file: Path
    object_name: str
    azimuth_deg: float  # [0, 360) of the camera about the object, counter-clockwise from above
    elevation_deg: float
    range_m: float = RANGE_M
    mask_file: Path | None = None  # bright on the object; None: it stands before a plain background

    def pixels(self) -> tuple[Bytes, Flags]:
        """(H, W, 3) RGB and (H, W) where the object is; raises InputError."""
        image = np.ascontiguousarray(read_picture(self.file, cv2.IMREAD_COLOR)[..., ::-1])
        if self.mask_file is None:
            return image, object_mask(image)
        mask = read_picture(self.mask_file, cv2.IMREAD_GRAYSCALE) > 127
        if mask.shape != image.shape[:2]:
            raise InputError(f"{self.mask_file}: of another size than {self.file.name}; give the picture's own mask")
        return image, mask


@dataclass(frozen=True)
class Turntables:
    """Photographs in the order of object, elevation and azimuth, and how many files were none of them."""

    photographs: tuple[Photograph, ...]
    other_files: int


def by_pattern(root: Path, pattern: str, mask_pattern: str = "") -> Turntables:
    """Photographs below ``root`` whose relative paths have the pattern; raises InputError without any.

    ``mask_pattern`` uses the pattern's fields and names the mask of each; without one the background must be plain.
    """
    paths = PathPattern(pattern)
    found, others = [], 0
    for file in sorted(path for path in root.rglob("*") if path.is_file()):
        relative = file.relative_to(root).as_posix()
        named = paths.read(relative)
        if named is None:
            others += 1
            continue
        mask = root / paths.fill(mask_pattern, relative) if mask_pattern else None
        found.append(Photograph(file, named.object_name, named.azimuth_deg, named.elevation_deg, RANGE_M, mask))
    if not found:
        raise InputError(f"{root}: none of {others} files is '{pattern}'; correct the pattern or the folder")
    return Turntables(_ordered(found), others)


def by_table(path: Path) -> Turntables:
    """Photographs that a CSV file lists under ``REQUIRED`` and ``OPTIONAL`` columns; raises InputError."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:  # spreadsheets put a byte-order mark in front
            reader = csv.DictReader(file)
            _check_columns(path, reader.fieldnames or ())
            found = [_of_row(path, number, row) for number, row in enumerate(reader, 2)]
    except (OSError, UnicodeDecodeError, csv.Error) as fault:
        raise InputError(f"{path}: not a readable table ({fault}); give a CSV file in UTF-8") from None
    if not found:
        raise InputError(f"{path}: no photographs after the header; add a line for each")
    return Turntables(_ordered(found), 0)


def _ordered(found: list[Photograph]) -> tuple[Photograph, ...]:
    return tuple(sorted(found, key=lambda own: (own.object_name, own.elevation_deg, own.azimuth_deg, own.file)))


def _check_columns(path: Path, names: Sequence[str]) -> None:
    missing = [name for name in REQUIRED if name not in names]
    unknown = [name for name in names if name not in REQUIRED + OPTIONAL]
    if missing or unknown:
        fault = f"no column {missing[0]}" if missing else f"unknown column '{unknown[0]}'"
        raise InputError(f"{path}: {fault}; columns are {', '.join(REQUIRED)} and perhaps {', '.join(OPTIONAL)}")


def _of_row(path: Path, number: int, row: Mapping[str, str | None]) -> Photograph:
    where = f"{path}, line {number}"
    if not row["file"] or not row["object"]:
        raise InputError(f"{where}: file or object is empty; complete the line")
    azimuth, elevation = _number(where, row, "azimuth_deg", None), _number(where, row, "elevation_deg", 0.0)
    range_m = _number(where, row, "range_m", RANGE_M)
    mask = row.get("mask")
    return Photograph(
        path.parent / row["file"],
        row["object"],
        azimuth % 360.0,
        elevation,
        range_m,
        path.parent / mask if mask else None,
    )


def _number(where: str, row: Mapping[str, str | None], column: str, default: float | None) -> float:
    text = row.get(column)
    if not text and default is not None:
        return default
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{where}: {column} is '{text}', not a number; correct it")
    return value
