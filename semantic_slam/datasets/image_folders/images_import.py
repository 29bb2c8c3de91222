"""``import_dataset images``: pictures of a hand-held camera with depth, levelled or in all six, as an input bag."""

import argparse
from dataclasses import replace
from pathlib import Path

from tqdm import tqdm

from semantic_slam.datasets.drives.drive import Drive, Written, write_drive
from semantic_slam.datasets.drives.noisy_odometry import add_drift, check_drift
from semantic_slam.datasets.drives.tables import found_or_none
from semantic_slam.datasets.image_folders.detections import (
    Detector,
    found_by,
    own_boxes,
    with_bearings,
    with_named_classes,
    with_positions,
)
from semantic_slam.datasets.image_folders.detector_arguments import add_detector, detector_of
from semantic_slam.datasets.image_folders.image_folder import ImageFolder
from semantic_slam.datasets.image_folders.images_in_space import drive_in_space, write_images_in_space
from semantic_slam.datasets.image_folders.journey import Journey, frame_stamps_ns, journey_by_odometry, journey_by_truth
from semantic_slam.datasets.image_folders.layouts import read_image_folder
from semantic_slam.datasets.image_folders.pictures import pictures_of
from semantic_slam.errors import InputError
from semantic_slam.perception.frame import Detections

ODOMETRY_FILE = "odometry.txt"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of ``import_dataset images``."""
    parser.add_argument("source", type=Path, metavar="SRC", help="folder laid out as 7-Scenes or CubeSLAM")
    parser.add_argument("--out", required=True, type=Path, metavar="BAG", help="bag folder to write")
    add_detector(parser, "the folder's own boxes")
    parser.add_argument(
        "--odometry",
        type=Path,
        metavar="FILE",
        help=f"t x y z qx qy qz qw of the camera (default: SRC/{ODOMETRY_FILE}, else the true increments with noise)",
    )
    parser.add_argument(
        "--depth-to-width",
        type=float,
        default=0.0,
        metavar="SHARE",
        help="how far behind the surface an object's place is, in widths that it shows: 0.5 for round and square ones"
        " that are seen from all around (default: the surface)",
    )
    parser.add_argument("--space", action="store_true", help="all six of the camera's pose, not levelled to the plane")
    add_drift(parser)
    parser.add_argument("--max-keyframes", type=int, metavar="N", help="stop after N pictures")


def run(arguments: argparse.Namespace, bag: Path) -> None:
    """Write the bag and say what it holds; raises InputError."""
    check_drift(arguments)
    if not 0.0 <= arguments.depth_to_width <= 1.0:
        raise InputError(f"--depth-to-width {arguments.depth_to_width}: must be in 0..1")
    detector = detector_of(arguments)
    folder = read_image_folder(arguments.source)
    folder = replace(folder, frames=folder.frames[: arguments.max_keyframes])
    file = arguments.odometry or found_or_none(arguments.source, ODOMETRY_FILE)
    found, share = found_in(folder, detector), arguments.depth_to_width
    if arguments.space:
        drive = drive_in_space(folder, file, arguments.drift, arguments.seed)
        written = write_images_in_space(folder, drive, found, bag, share)
    else:
        journey = (
            journey_by_truth(folder, arguments.drift, arguments.seed)
            if file is None
            else journey_by_odometry(folder, file)
        )
        written = write_images(folder, journey, found, bag, share)
    print(f"{arguments.out}: {written}")
    made_up = "" if folder.has_clock else "stamps are made up; "
    noise = f"the true increments with noise (--drift {arguments.drift:g})"
    print(f"{made_up}odometry: {file or noise}; boxes: {arguments.detector or 'of the folder'}")


def found_in(folder: ImageFolder, detector: Detector | None) -> list[Detections]:
    """(F,) boxes of every frame, a detector's or the folder's own. Raises InputError where there are none at all."""
    if detector is None and all(frame.boxes is None for frame in folder.frames):
        raise InputError(f"{folder.path}: has no boxes of its own; name a detector with --detector and --labels-of")
    find = own_boxes if detector is None else found_by(detector)
    frames = zip(folder.frames, frame_stamps_ns(folder).tolist(), strict=True)
    return [find(frame, stamp) for frame, stamp in tqdm(frames, total=len(folder.frames), desc="boxes", unit="image")]


def write_images(
    folder: ImageFolder, journey: Journey, found: list[Detections], bag: Path, depth_to_width: float = 0.0
) -> Written:
    """Write the bag of a folder in whose frames these (F,) boxes were found. Raises InputError."""
    rotations = journey.R_body_camera
    frames = zip(folder.frames, with_named_classes(found), rotations, strict=True)
    drive = Drive(
        odometry=journey.odometry,
        frames=[
            with_bearings(
                with_positions(told, folder.depth_m(frame), folder.camera, rotation, depth_to_width),
                folder.camera,
                rotation,
            )
            for frame, told, rotation in frames
        ],
        truth=journey.truth,
    )
    return write_drive(drive, bag, "images", pictures=pictures_of(folder, journey.stamps_ns.tolist(), rotations))
