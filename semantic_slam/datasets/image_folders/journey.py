"""How the camera of a folder moved: levelled, as its odometry has it and as it was."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from semantic_slam.datasets.drives.drive import Path2D
from semantic_slam.datasets.drives.noisy_odometry import noisy_odometry
from semantic_slam.datasets.drives.tables import nanoseconds
from semantic_slam.datasets.image_folders.image_folder import ImageFolder
from semantic_slam.datasets.image_folders.levelling import at_times, levelled
from semantic_slam.datasets.image_folders.tum_poses import read_tum_poses
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array

START_NS = 1_000_000_000
"""Stamp of time zero where times are made up; zero means "no stamp" to many tools."""


@dataclass(frozen=True, kw_only=True)
class Journey:
    """F frames."""

    stamps_ns: NDArray[np.int64]  # (F,)
    R_body_camera: Array  # (F, 3, 3) of the optical frame, in the level body
    odometry: Path2D
    truth: Path2D | None


def journey_by_truth(folder: ImageFolder, drift: float, seed: int) -> Journey:
    """Odometry is the true increments with noise; raises InputError where no poses are known."""
    poses = folder.poses
    if poses is None:
        raise InputError(f"{folder.path}: neither poses nor odometry; give the camera's odometry with --odometry")
    path, stamps_ns = levelled(poses, folder.down), frame_stamps_ns(folder)
    rng = np.random.default_rng([seed, *folder.path.name.encode()])
    return Journey(
        stamps_ns=stamps_ns,
        R_body_camera=path.R_body_camera,
        odometry=Path2D(stamps_ns, noisy_odometry(path.poses, drift, rng)),
        truth=Path2D(stamps_ns, path.poses),
    )


def journey_by_odometry(folder: ImageFolder, file: Path) -> Journey:
    """Odometry is that of a file, in the folder's times; level by the poses, or without these by the odometry.

    Raises InputError.
    """
    times_s, measured = read_tum_poses(file)
    known, down = folder.poses, folder.down
    if known is None:
        known = _at_frames(folder, file, times_s, measured)
    else:
        first, _ = at_times(_times_s(folder), known, times_s[:1])
        down = measured[0, :3, :3] @ first[0, :3, :3].T @ folder.down
    path, stamps_ns = levelled(known, folder.down), frame_stamps_ns(folder)
    return Journey(
        stamps_ns=stamps_ns,
        R_body_camera=path.R_body_camera,
        odometry=Path2D(stamps_ns_of(folder, times_s), levelled(measured, down).poses),
        truth=None if folder.poses is None else Path2D(stamps_ns, path.poses),
    )


def _at_frames(folder: ImageFolder, file: Path, times_s: Array, measured: Array) -> Array:
    """(F, 4, 4) odometry at the frames; raises InputError for a frame that has none."""
    poses, are_near = at_times(times_s, measured, _times_s(folder))
    if not are_near.all():
        time_s = _times_s(folder)[np.argmin(are_near)]
        raise InputError(f"{file}: no pose at {time_s:.3f} s, where {folder.path} has a picture; give one for each")
    return poses


def _times_s(folder: ImageFolder) -> Array:
    return np.array([frame.time_s for frame in folder.frames])


def frame_stamps_ns(folder: ImageFolder) -> NDArray[np.int64]:
    """(F,) of its frames."""
    return stamps_ns_of(folder, _times_s(folder))


def stamps_ns_of(folder: ImageFolder, times_s: Array) -> NDArray[np.int64]:
    """Stamps of times of a folder."""
    return nanoseconds(times_s) + (0 if folder.has_clock else START_NS)
