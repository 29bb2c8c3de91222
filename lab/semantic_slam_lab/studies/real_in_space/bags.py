"""The kitchen and the cabinet as bags in space: with places by depth, or boxes alone."""

from dataclasses import replace
from pathlib import Path

from semantic_slam.datasets.image_folders.image_folder import ImageFolder
from semantic_slam.datasets.image_folders.images_import import found_in
from semantic_slam.datasets.image_folders.images_in_space import drive_in_space
from semantic_slam.datasets.space.drive import SpatialDrive, write_spatial_drive
from semantic_slam.datasets.space.mount import mounted
from semantic_slam.perception.frame import Detections
from semantic_slam_lab.studies.real_kitchen.front_end import front_end

DRIFT = 0.02
"""Noise of the cabinet's odometry, which is made of its true poses."""


def kitchen(folder: ImageFolder, weights: Path, place: Path, seed: int) -> tuple[SpatialDrive, list[Detections]]:
    """How the camera moved by visual odometry, and NanoDet's boxes. Raises InputError."""
    told, odometry = front_end(folder, weights, seed), place / "odometry.txt"
    told.write_odometry(odometry)
    return drive_in_space(folder, odometry, 0.0, seed), told.found


def cabinet(folder: ImageFolder, seed: int) -> tuple[SpatialDrive, list[Detections]]:
    """How the camera moved by its true increments with noise, and the boxes of the folder. Raises InputError."""
    return drive_in_space(folder, None, DRIFT, seed), found_in(folder, None)


def write(folder: ImageFolder, drive: SpatialDrive, frames: list[Detections], bag: Path) -> None:
    """A bag without pictures."""
    first_ns = min(int(drive.odometry.stamps_ns[0]), frames[0].stamp_ns)
    write_spatial_drive(replace(drive, frames=frames), bag, "bag", others=mounted(folder.camera, first_ns))
