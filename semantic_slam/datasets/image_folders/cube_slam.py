"""Folders as CubeSLAM has them of TUM's fr3_cabinet: ``raw_imgs``, ``depth_imgs``, boxes, ``truth_cam_poses.txt``.

Boxes are those of a detector that looks for one thing, x y w h p a line; poses are t x y z qx qy qz qw, one for every
picture, in a world whose z axis points up (Yang and Scherer, T-RO 2019; Sturm et al., IROS 2012).
"""

import re
from pathlib import Path

import numpy as np

from semantic_slam.datasets.image_folders.image_folder import ImageFolder, ImageFrame
from semantic_slam.datasets.image_folders.intrinsics import camera_of
from semantic_slam.datasets.image_folders.tum_poses import read_tum_poses
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array

COLOUR = re.compile(r"(\d+)_rgb_raw\.(?:jpg|png)")
POSES = "truth_cam_poses.txt"
RESTORE = "restore it from the data set"
RATE_HZ = 1.0
"""Made-up times of pictures without poses: key frames, about one a second."""
DEPTH_PER_METRE = 5000.0
FREIBURG_3 = (535.4, 539.2, 320.1, 247.6)
"""fx fy cx cy of the camera of TUM's fr3 recordings, where ``camera.txt`` states no other."""
DOWN = np.array([0.0, 0.0, -1.0])


def is_cube_slam(folder: Path) -> bool:
    """Whether a folder has pictures where CubeSLAM has them."""
    return (folder / "raw_imgs").is_dir() and (folder / "depth_imgs").is_dir()


def read_cube_slam(folder: Path) -> ImageFolder:
    """All pictures that have depth; raises InputError where there are not as many poses as pictures."""
    matches = [(COLOUR.fullmatch(path.name), path) for path in sorted((folder / "raw_imgs").iterdir())]
    named = [(match[1], path) for match, path in matches if match]
    times = [int(number) / RATE_HZ for number, _ in named]
    poses: list[Array | None] = [None] * len(named)
    known = (folder / POSES).is_file()
    if known:
        stamps, matrices = read_tum_poses(folder / POSES)
        if len(stamps) != len(named):
            raise InputError(f"{folder / POSES}: {len(stamps)} poses for {len(named)} pictures; {RESTORE}")
        times, poses = stamps.tolist(), list(matrices)
    rows = zip(named, times, poses, strict=True)
    frames = tuple(_frame(folder, number, path, time_s, pose) for (number, path), time_s, pose in rows)
    frames = tuple(frame for frame in frames if frame.depth.is_file())
    if not frames:
        raise InputError(f"{folder}: no picture has depth; name a folder of colour and depth")
    return ImageFolder(
        path=folder,
        frames=frames,
        camera=camera_of(folder, frames[0].colour, FREIBURG_3),
        depth_per_metre=DEPTH_PER_METRE,
        down=DOWN,
        has_clock=known,
    )


def _frame(folder: Path, number: str, colour: Path, time_s: float, pose: Array | None) -> ImageFrame:
    boxes = sorted((folder / "filter_2d_obj_txts").glob(f"{number}_*.txt"))
    return ImageFrame(
        time_s=time_s,
        colour=colour,
        depth=folder / "depth_imgs" / f"{number}_depth_raw.png",
        boxes=boxes[0] if boxes else None,
        T_world_camera=pose,
    )
