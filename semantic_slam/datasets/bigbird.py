"""BigBIRD's turntable views (and YCB's, and those of ``make_scene --turntable``), read from their on-disk format.

``<object>/NP{k}_{a}.jpg`` with k = 1..5 cameras (1 the lowest) and the table's angle a in degrees, beside it ``.h5``
depth, ``masks/NP{k}_{a}_mask.pbm`` (object 0), ``poses/NP5_{a}_pose.h5`` and one ``calibration.h5``. In the table frame
the object stands still and the cameras orbit: T_table_camera = H_table_from_reference_camera @ inv(H_NPk_from_NP5).
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import h5py
import numpy as np
from numpy.typing import NDArray

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages.images import MOST_PIXELS
from semantic_slam.messages.picture_files import read_picture

CAMERAS = ("NP1", "NP2", "NP3", "NP4", "NP5")
METRES_PER_RAW_DEPTH = 1e-4
LEAST_DETERMINANT = 0.5
"""That of a rigid motion is 1."""


@dataclass(frozen=True)
class TurntableCalibration:
    """Intrinsics and rig of the five cameras; keys are camera names."""

    rgb_matrices: Mapping[str, Array]  # (3, 3)
    rgb_distortions: Mapping[str, Array]  # (5,)
    depth_scales: Mapping[str, float]
    camera_from_reference: Mapping[str, Array]  # (4, 4) H_NPk_from_NP5


@dataclass(frozen=True)
class TurntableView:
    """One picture of an object on the turntable; pixels are read when asked for."""

    folder: Path
    object_name: str
    camera: str  # NP1 .. NP5
    angle_deg: int
    table_from_camera: Array  # (4, 4)
    depth_scale: float

    @property
    def stem(self) -> str:
        return f"{self.camera}_{self.angle_deg}"

    @property
    def viewpoint(self) -> tuple[float, float, float]:
        """Azimuth [rad] about the table's z from its x axis, elevation [rad] and range [m] of the camera."""
        x, y, z = self.table_from_camera[:3, 3]
        return float(np.arctan2(y, x)), float(np.arctan2(z, np.hypot(x, y))), float(np.linalg.norm([x, y, z]))

    @cached_property
    def image(self) -> NDArray[np.uint8]:
        """(height, width, 3) RGB picture of the view."""
        return np.ascontiguousarray(read_picture(self.folder / f"{self.stem}.jpg", cv2.IMREAD_COLOR)[..., ::-1])

    @cached_property
    def mask(self) -> NDArray[np.bool_]:
        """(height, width) of the picture, true on the object."""
        return np.asarray(read_picture(self.folder / "masks" / f"{self.stem}_mask.pbm", cv2.IMREAD_GRAYSCALE) == 0)

    @property
    def box(self) -> Array:
        """(4,) x_min y_min x_max y_max of the mask, pixels; raises InputError when it is empty."""
        rows, columns = np.flatnonzero(self.mask.any(axis=1)), np.flatnonzero(self.mask.any(axis=0))
        if not len(rows):
            path = self.folder / "masks" / f"{self.stem}_mask.pbm"
            raise InputError(f"{path}: no object in the mask; remove this view or restore the file")
        return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], dtype=np.float64)

    @cached_property
    def depth_m(self) -> NDArray[np.float32]:
        """(height, width) of the depth camera, NaN where nothing was measured."""
        path = self.folder / f"{self.stem}.h5"
        raw = _dataset(path, "depth").astype(np.float32)
        if raw.ndim != 2:
            raise InputError(f"{path}: 'depth' is no picture; restore the file from the data set")
        return np.where(raw == 0, np.nan, raw * (METRES_PER_RAW_DEPTH * self.depth_scale)).astype(np.float32)


def object_folders(root: Path) -> tuple[Path, ...]:
    """Folders of objects in ``root``, by name, or ``root`` itself when it is one; raises InputError without any."""
    if (root / "calibration.h5").is_file():
        return (root,)
    folders = tuple(sorted(path.parent for path in root.glob("*/calibration.h5")))
    if not folders:
        raise InputError(
            f"{root}: no <object>/calibration.h5 below; name a folder in BigBIRD's layout (make_scene --turntable)"
        )
    return folders


def read_calibration(folder: Path) -> TurntableCalibration:
    """``calibration.h5`` of an object; raises InputError that names what is missing."""
    path = folder / "calibration.h5"
    return TurntableCalibration(
        rgb_matrices={name: _dataset(path, f"{name}_rgb_K", (3, 3)) for name in CAMERAS},
        rgb_distortions={name: _dataset(path, f"{name}_rgb_d") for name in CAMERAS},
        depth_scales={name: float(_dataset(path, f"{name}_ir_depth_scale", (1,))[0]) for name in CAMERAS},
        camera_from_reference={name: _motion(path, f"H_{name}_from_NP5") for name in CAMERAS},
    )


def turntable_views(folder: Path, cameras: Sequence[str] = CAMERAS) -> Iterator[TurntableView]:
    """Views of one object, by camera and angle, one at a time; raises InputError for missing pieces."""
    calibration = read_calibration(folder)
    for camera in cameras:
        angles = sorted(
            int(match[1])
            for path in folder.glob(f"{camera}_*.jpg")
            if (match := re.fullmatch(rf"{camera}_(\d+)", path.stem))
        )
        if not angles:
            raise InputError(f"{folder}: no {camera}_*.jpg; download the object's pictures too, or leave {camera} out")
        for angle in angles:
            pose = _dataset(folder / "poses" / f"NP5_{angle}_pose.h5", "H_table_from_reference_camera", (4, 4))
            table_from_camera = pose @ np.linalg.inv(calibration.camera_from_reference[camera])
            yield TurntableView(folder, folder.name, camera, angle, table_from_camera, calibration.depth_scales[camera])


def _motion(path: Path, name: str) -> Array:
    """(4, 4) that can be inverted. Raises InputError."""
    found = _dataset(path, name, (4, 4))
    if not np.isfinite(found).all() or abs(np.linalg.det(found)) < LEAST_DETERMINANT:
        raise InputError(f"{path}: '{name}' is no motion; restore the file from the data set")
    return found


def _dataset(path: Path, name: str, shape: tuple[int, ...] | None = None) -> Array:
    """Numbers of an HDF5 file; raises InputError, for more bytes than MOST_PIXELS numbers have before they are read."""
    try:
        with h5py.File(path, "r") as file:
            found = file[name]
            if found.nbytes > np.dtype(np.float64).itemsize * MOST_PIXELS:
                raise InputError(f"{path}: '{name}' has more than {MOST_PIXELS} numbers; restore it from the data set")
            if found.dtype.kind not in "uif":
                raise TypeError(f"{found.dtype} are no numbers")
            values = np.asarray(found[()], dtype=np.float64)
            return values if shape is None else values.reshape(shape)
    except (OSError, KeyError, AttributeError, TypeError, ValueError, RuntimeError, MemoryError):
        raise InputError(f"{path}: no readable '{name}'; restore the file from the data set") from None
