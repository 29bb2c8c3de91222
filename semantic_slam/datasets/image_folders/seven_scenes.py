"""Folders of the 7-Scenes data set: ``frame-NNNNNN.color.jpg``, ``.depth.png`` in millimetres, ``.pose.txt``.

``camera-intrinsics.txt`` is a 3 x 3 matrix, ``gravity-direction.txt`` three numbers in the world of the poses, without
which the world's z axis points up. Frames have numbers and no times: 30 a second (Shotton et al., CVPR 2013).
"""

import re
from pathlib import Path

import numpy as np

from semantic_slam.datasets.drives.tables import table
from semantic_slam.datasets.image_folders.image_folder import ImageFolder, ImageFrame
from semantic_slam.datasets.image_folders.intrinsics import camera_of, matrix_intrinsics
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array

COLOUR = re.compile(r"frame-(\d+)\.color\.(?:jpg|png)")
RATE_HZ = 30.0
DEPTH_PER_METRE = 1000.0
RESTORE = "restore it from the data set"
DOWN = np.array([0.0, 0.0, -1.0])


def is_seven_scenes(folder: Path) -> bool:
    """Whether a folder has pictures named as those of 7-Scenes."""
    return any(COLOUR.fullmatch(path.name) for path in folder.glob("frame-*"))


def read_seven_scenes(folder: Path) -> ImageFolder:
    """All frames that have depth; raises InputError where some have poses and others have none."""
    named = sorted((int(match[1]), path) for path in folder.iterdir() if (match := COLOUR.fullmatch(path.name)))
    frames = tuple(frame for number, path in named if (frame := _frame(number, path)) is not None)
    with_pose = sum(frame.T_world_camera is not None for frame in frames)
    if not frames:
        raise InputError(f"{folder}: no frame has a depth picture; name a folder of colour and depth")
    if with_pose not in (0, len(frames)):
        raise InputError(
            f"{folder}: {with_pose} of {len(frames)} frames have a pose; restore the others, or remove all"
        )
    matrix, gravity = folder / "camera-intrinsics.txt", folder / "gravity-direction.txt"
    known = matrix_intrinsics(_numbers(matrix, (3, 3))) if matrix.is_file() else None
    return ImageFolder(
        path=folder,
        frames=frames,
        camera=camera_of(folder, frames[0].colour, known),
        depth_per_metre=DEPTH_PER_METRE,
        down=_unit(gravity) if gravity.is_file() else DOWN,
        has_clock=False,
    )


def _frame(number: int, colour: Path) -> ImageFrame | None:
    """The frame of a colour picture; None without depth."""
    stem = colour.name.split(".")[0]
    depth, pose = colour.with_name(f"{stem}.depth.png"), colour.with_name(f"{stem}.pose.txt")
    if not depth.is_file():
        return None
    return ImageFrame(
        time_s=number / RATE_HZ,
        colour=colour,
        depth=depth,
        T_world_camera=_rigid(pose) if pose.is_file() else None,
    )


def _rigid(path: Path) -> Array:
    matrix = _numbers(path, (4, 4))
    rotation = matrix[:3, :3]
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-2 or np.linalg.det(rotation) < 0.0:
        raise InputError(f"{path}: not a rigid transform from camera to world; {RESTORE}")
    return matrix


def _unit(path: Path) -> Array:
    direction = _numbers(path, (3,))
    length = float(np.linalg.norm(direction))
    if length < 1e-3:
        raise InputError(f"{path}: no direction; three numbers that point down are expected")
    return np.asarray(direction / length)


def _numbers(path: Path, shape: tuple[int, ...]) -> Array:
    columns = ("number",) * (shape[1] if len(shape) > 1 else 1)
    numbers = table(path, columns, RESTORE, time=False)
    if numbers.size != np.prod(shape):
        raise InputError(f"{path}: {numbers.size} numbers in place of {' x '.join(map(str, shape))}; {RESTORE}")
    return numbers.reshape(shape)
