"""The photographs of a folder, and which of them train, test, calibrate and validate."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from semantic_slam.datasets.turntables.photographs import by_pattern
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.training.turntables import views_of
from semantic_slam.training.views import ObjectView

FOLDER = "coil100"
PATTERNS = ("{object}__{azimuth}.jpg", "{object}__{azimuth}.png")
TRAIN_STEP_DEG = 20
FRONT_RAD = float(np.deg2rad(80.0))
LEAST_OBJECTS = 6
"""Five for a draw, one to choose among."""


@dataclass(frozen=True)
class Photographs:
    """N views of the objects of a folder."""

    views: tuple[ObjectView, ...]
    names: tuple[str, ...]  # of the objects, sorted
    instance: Index  # (N,)
    azimuth_rad: Array  # (N,)

    def of(self, name: str) -> Index:
        """Rows of an object's views."""
        return np.flatnonzero(self.instance == self.names.index(name))

    def training(self, name: str) -> Index:
        """Rows of the views nearest to every multiple of TRAIN_STEP_DEG, where one is near."""
        rows = self.of(name)
        wanted = np.deg2rad(np.arange(0, 360, TRAIN_STEP_DEG))
        away = np.abs(wrap_angle(self.azimuth_rad[rows][None] - wanted[:, None]))
        near = away.min(axis=1) < np.deg2rad(0.5 * TRAIN_STEP_DEG)
        return np.unique(rows[away.argmin(axis=1)[near]])

    def others(self, name: str) -> Index:
        """Rows of the views that do not train."""
        return np.setdiff1d(self.of(name), self.training(name))

    def front(self, rows: Index) -> Index:
        """The rows that see an object's front."""
        return rows[np.abs(self.azimuth_rad[rows]) <= FRONT_RAD + 1e-9]


def read_photographs(data: Path, pattern: str = "", mask_pattern: str = "") -> Photographs:
    """Photographs in ``data``/coil100, or in ``data`` itself; raises InputError where they are too few.

    Without a ``pattern`` of their paths they are named as COIL-100's, with either suffix.
    """
    folder = data / FOLDER if (data / FOLDER).is_dir() else data
    return collected(views_of(by_pattern(folder, pattern or _coils(folder), mask_pattern).photographs), folder)


def _coils(folder: Path) -> str:
    """The pattern of COIL-100 with the suffix that the folder's files have."""
    return next((own for own in PATTERNS if any(folder.rglob(own.format(object="*", azimuth="*")))), PATTERNS[0])


def collected(views: Sequence[ObjectView], folder: Path) -> Photographs:
    """The views with what is asked of them again and again; raises InputError where objects are too few."""
    names = tuple(sorted({view.class_name for view in views}))
    if len(names) < LEAST_OBJECTS:
        raise InputError(f"{folder}: {len(names)} objects; {LEAST_OBJECTS} at least are needed")
    instance = np.array([names.index(view.class_name) for view in views])
    return Photographs(tuple(views), names, instance, np.array([view.azimuth_rad for view in views]))
