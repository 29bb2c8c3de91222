"""Which layouts of folders are known."""

from collections.abc import Callable
from pathlib import Path

from semantic_slam.datasets.image_folders.cube_slam import is_cube_slam, read_cube_slam
from semantic_slam.datasets.image_folders.image_folder import ImageFolder
from semantic_slam.datasets.image_folders.seven_scenes import is_seven_scenes, read_seven_scenes
from semantic_slam.errors import InputError

LAYOUTS: tuple[tuple[Callable[[Path], bool], Callable[[Path], ImageFolder]], ...] = (
    (is_seven_scenes, read_seven_scenes),
    (is_cube_slam, read_cube_slam),
)
"""(whether a folder is laid out so, how it is read)"""


def read_image_folder(folder: Path) -> ImageFolder:
    """The frames of a folder in any layout that is known; raises InputError for another."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no folder; name one of colour and depth pictures")
    for is_laid_out_so, read in LAYOUTS:
        if is_laid_out_so(folder):
            return read(folder)
    raise InputError(
        f"{folder}: neither frame-NNNNNN.color.jpg with .depth.png, nor raw_imgs with depth_imgs; docs/datasets.md"
        " shows the layouts"
    )
