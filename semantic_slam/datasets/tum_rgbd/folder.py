"""A folder of the TUM RGB-D benchmark's kind: poses, intrinsics, boxes and, where they are kept, pictures.

``groundtruth.txt`` and ``odometry.txt`` have lines t x y z qx qy qz qw of the camera's optical frame, ``rgb.txt`` and
``depth.txt`` lines of a time and a file (Sturm et al., IROS 2012).
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from semantic_slam.datasets.drives.tables import found_or_none, lines_of, nanoseconds, numbers
from semantic_slam.datasets.image_folders.intrinsics import stated_camera
from semantic_slam.datasets.image_folders.tum_poses import read_tum_poses
from semantic_slam.datasets.space.levelling import OPTICAL
from semantic_slam.datasets.space.path import SpatialPath, of_camera
from semantic_slam.errors import InputError
from semantic_slam.perception.frame import CameraModel

DEPTH_PER_METRE = 5000.0
TRUTH, ODOMETRY = "groundtruth.txt", "odometry.txt"
PICTURE_REMEDY = "lines of 'time file' are expected"


@dataclass(frozen=True)
class Pictures:
    """N files of one kind at stamps that grow."""

    stamps_ns: NDArray[np.int64]  # (N,)
    files: tuple[Path, ...]  # (N,)

    @property
    def are_there(self) -> bool:
        """Whether the files were kept, not their list alone."""
        return bool(self.files) and self.files[0].is_file()

    def nearest(self, stamp_ns: int, tolerance_ns: int) -> Path | None:
        """The file nearest in time; None where none is near."""
        if not self.files:
            return None
        row = int(np.abs(self.stamps_ns - stamp_ns).argmin())
        return self.files[row] if abs(int(self.stamps_ns[row]) - stamp_ns) <= tolerance_ns else None


@dataclass(frozen=True, kw_only=True)
class TumFolder:
    """What is there; paths are those of a body at the camera, x ahead, y left, z up in the picture."""

    path: Path
    camera: CameraModel
    truth: SpatialPath | None
    odometry: SpatialPath | None
    colour: Pictures
    depth: Pictures


def read_tum_folder(folder: Path) -> TumFolder:
    """Everything but boxes and readings of an inertial sensor. Raises InputError."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no folder; name one with {TRUTH} or {ODOMETRY}, camera.txt and detections.csv")
    truth, odometry = _path(folder, TRUTH), _path(folder, ODOMETRY)
    if truth is None and odometry is None:
        raise InputError(f"{folder}: neither {TRUTH} nor {ODOMETRY}; give the camera's odometry, or its true poses")
    return TumFolder(
        path=folder,
        camera=stated_camera(folder),
        truth=truth,
        odometry=odometry,
        colour=_pictures(folder, "rgb.txt"),
        depth=_pictures(folder, "depth.txt"),
    )


def _path(folder: Path, name: str) -> SpatialPath | None:
    file = found_or_none(folder, name)
    if file is None:
        return None
    times_s, poses = read_tum_poses(file)
    if len(times_s) < 2:
        raise InputError(f"{file}: one pose, and no motion; restore the file")
    return of_camera(nanoseconds(times_s), poses, OPTICAL)


def _pictures(folder: Path, name: str) -> Pictures:
    """The pictures of a list; none where there is no list."""
    file = found_or_none(folder, name)
    times: list[float] = []
    files = []
    for line in lines_of(file, PICTURE_REMEDY) if file is not None else ():
        if len(line.words) < 2:
            raise line.fault(f"{len(line.words)} columns, expected time file", PICTURE_REMEDY)
        times += numbers(line, ("time",), PICTURE_REMEDY)
        if len(times) > 1 and times[-1] <= times[-2]:
            raise line.fault(f"time goes backwards, from {times[-2]:.6f} to {times[-1]:.6f}", "sort its lines")
        files.append(folder / line.words[1])
    return Pictures(nanoseconds(np.array(times)), tuple(files))
