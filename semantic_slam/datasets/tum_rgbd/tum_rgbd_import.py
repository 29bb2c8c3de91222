"""``import_dataset tum_rgbd``: a hand-held camera in all six, with a detector's boxes, as an input bag."""

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from semantic_slam.datasets.drives.drive import Message
from semantic_slam.datasets.drives.noisy_odometry import add_drift, check_drift
from semantic_slam.datasets.drives.tables import found_or_none
from semantic_slam.datasets.image_folders.detections import Detector
from semantic_slam.datasets.image_folders.detector_arguments import add_detector, detector_of
from semantic_slam.datasets.space.drive import SpatialDrive, write_spatial_drive
from semantic_slam.datasets.space.journey import drive_by_odometry, odometry_of
from semantic_slam.datasets.space.mount import mounted
from semantic_slam.datasets.tum_rgbd.boxes import read_placed_objects
from semantic_slam.datasets.tum_rgbd.folder import ODOMETRY, TRUTH, TumFolder, read_tum_folder
from semantic_slam.datasets.tum_rgbd.inertial import accelerations_of, up_of
from semantic_slam.datasets.tum_rgbd.sightings import DETECTIONS, found_boxes, pictures_at, with_places
from semantic_slam.messages import topics

OBJECTS, INERTIAL = "objects.csv", "imu.txt"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of ``import_dataset tum_rgbd``."""
    parser.add_argument(
        "source", type=Path, metavar="SRC", help="folder of groundtruth.txt or odometry.txt, camera.txt, detections.csv"
    )
    parser.add_argument("--out", required=True, type=Path, metavar="BAG", help="bag folder to write")
    add_detector(parser, "the boxes of detections.csv")
    add_drift(parser)
    parser.add_argument("--max-keyframes", type=int, metavar="N", help="stop after N frames")


def run(arguments: argparse.Namespace, bag: Path) -> None:
    """Write the bag and say what it holds; raises InputError."""
    check_drift(arguments)
    detector = detector_of(arguments)
    folder = read_tum_folder(arguments.source)
    drive = read_drive(folder, arguments.drift, arguments.seed, detector, arguments.max_keyframes)
    written = write_spatial_drive(drive, bag, "tum_rgbd", arguments.max_keyframes, of_camera(folder, drive))
    print(f"{arguments.out}: {written}")
    noise = f"the true increments with noise (--drift {arguments.drift:g})"
    odometry = noise if folder.odometry is None else folder.path / ODOMETRY
    print(f"odometry: {odometry}; boxes: {arguments.detector or folder.path / DETECTIONS}")
    print(f"up is {_up(folder)}")


def _up(folder: TumFolder) -> str:
    if found_or_none(folder.path, INERTIAL) is not None:
        return f"by {INERTIAL}, which is topic {topics.IMU}, too"
    return f"the z axis of {ODOMETRY if folder.truth is None else TRUTH}"


def read_drive(
    folder: TumFolder, drift: float, seed: int, detector: Detector | None = None, max_keyframes: int | None = None
) -> SpatialDrive:
    """What the camera did and saw, up to the ``max_keyframes``-th frame. Raises InputError."""
    objects_file = found_or_none(folder.path, OBJECTS)
    objects = None if objects_file is None else read_placed_objects(objects_file)
    frames, associations = found_boxes(folder, detector)
    odometry = odometry_of(folder.odometry, folder.truth, folder.path.resolve().name, drift, seed)
    readings = found_or_none(folder.path, INERTIAL)
    up = None if readings is None else up_of(readings, odometry, folder.truth)
    return replace(
        drive_by_odometry(odometry, folder.truth, up=up, objects=objects),
        frames=[with_places(folder, told) for told in frames[:max_keyframes]],
        associations=None if associations is None else associations[:max_keyframes],
        accelerations=None if readings is None else accelerations_of(readings, odometry),
    )


def of_camera(folder: TumFolder, drive: SpatialDrive) -> Iterator[Message]:
    """Where the camera is on the body, its intrinsics and its pictures. Raises InputError."""
    stamps_ns = [frame.stamp_ns for frame in drive.frames]
    yield from mounted(folder.camera, min(int(drive.odometry.stamps_ns[0]), *stamps_ns))
    yield from pictures_at(folder, stamps_ns)
