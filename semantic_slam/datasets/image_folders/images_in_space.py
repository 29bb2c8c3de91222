"""A folder of pictures as a drive in space: all six of the camera's pose, gravity along z."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from semantic_slam.datasets.drives.drive import Message, Written
from semantic_slam.datasets.image_folders.detections import with_named_classes, with_positions
from semantic_slam.datasets.image_folders.image_folder import ImageFolder
from semantic_slam.datasets.image_folders.journey import frame_stamps_ns, stamps_ns_of
from semantic_slam.datasets.image_folders.pictures import picture
from semantic_slam.datasets.image_folders.tum_poses import read_tum_poses
from semantic_slam.datasets.space.drive import SpatialDrive, write_spatial_drive
from semantic_slam.datasets.space.journey import drive_by_odometry, odometry_of
from semantic_slam.datasets.space.levelling import OPTICAL
from semantic_slam.datasets.space.mount import mounted
from semantic_slam.datasets.space.path import of_camera
from semantic_slam.geometry.pose import rotation_matrix
from semantic_slam.perception.frame import Detections


def drive_in_space(folder: ImageFolder, file: Path | None, drift: float, seed: int) -> SpatialDrive:
    """How the camera moved, without what it saw; odometry of a ``file``, or None: the true increments with noise.

    Raises InputError.
    """
    stamps_ns, poses = frame_stamps_ns(folder), folder.poses
    truth = None if poses is None else of_camera(stamps_ns, poses, OPTICAL)
    told = None
    if file is not None:
        times_s, measured = read_tum_poses(file)
        told = of_camera(stamps_ns_of(folder, times_s), measured, OPTICAL)
    odometry = odometry_of(told, truth, folder.path.name, drift, seed)
    return drive_by_odometry(odometry, truth, up_in_world=-folder.down)


def write_images_in_space(
    folder: ImageFolder, drive: SpatialDrive, found: list[Detections], bag: Path, depth_to_width: float = 0.0
) -> Written:
    """Write the bag of a folder in whose frames these (F,) boxes were found. Raises InputError."""
    frames = with_places(folder, found, depth_to_width)
    return write_spatial_drive(replace(drive, frames=frames), bag, "images", others=_camera(folder))


def with_places(folder: ImageFolder, found: list[Detections], depth_to_width: float = 0.0) -> list[Detections]:
    """(F,) boxes with their places in the body of the camera, where depth tells them. Raises InputError."""
    rotation = rotation_matrix(OPTICAL[3:])
    return [
        with_positions(told, folder.depth_m(frame), folder.camera, rotation, depth_to_width)
        for frame, told in zip(folder.frames, with_named_classes(found), strict=True)
    ]


def _camera(folder: ImageFolder) -> Iterator[Message]:
    stamps_ns = frame_stamps_ns(folder).tolist()
    yield from mounted(folder.camera, stamps_ns[0])
    for frame, stamp_ns in zip(folder.frames, stamps_ns, strict=True):
        yield from picture(frame.colour, folder.depth_m(frame), stamp_ns)
