"""``import_dataset avd``: a drive through a scene of the Active Vision Dataset, or of make_scene, as an input bag."""

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from semantic_slam.bag.writer import BagWriter
from semantic_slam.datasets.avd.drive import INITIAL_SIGMA, Drive, ImportSettings
from semantic_slam.datasets.avd.objects import triangulated_prior, true_objects, uncertain_prior
from semantic_slam.datasets.avd.path import Stop, automatic_tour, read_path
from semantic_slam.datasets.avd.scene import AvdScene, find_scene, read_scene
from semantic_slam.datasets.planar_odometry import Odometry, OdometryNoise, simulate_odometry
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array

PURPOSES = {"odometry": 11, "initial_pose": 12, "map_prior": 13}
"""Keys that make the random draws of one seed independent."""


@dataclass(frozen=True)
class Imported:
    """What the bag holds."""

    keyframes: int
    odometry_samples: int
    detections: int
    skipped: Counter[str]  # reason -> boxes
    rebuilt: tuple[str, ...]  # images on the path whose rotation was rebuilt
    dead_reckoning_ate_m: float  # of the odometry from the true start
    triangulated: bool  # objects.json comes from boxes and depth, not from ground truth


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of ``import_dataset avd``."""
    default = ImportSettings()
    parser.add_argument("source", type=Path, metavar="SRC", help="folder of one scene")
    parser.add_argument(
        "--out", required=True, type=Path, metavar="BAG", help="bag folder to write; objects.json comes beside"
    )
    parser.add_argument(
        "--path", type=Path, metavar="FILE", help="image names or moves, one per line (default: a tour)"
    )
    parser.add_argument("--max-keyframes", type=int, metavar="N", help="stop after N images")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of odometry noise and priors (default: 0)")
    parser.add_argument(
        "--image-width", type=int, metavar="PX", help="scale the images to this width (default: as they are)"
    )
    parser.add_argument(
        "--max-difficulty", type=int, default=default.max_difficulty, metavar="1..5", help="of boxes (default: 2)"
    )
    parser.add_argument(
        "--min-box-height",
        type=float,
        default=default.min_box_height_px,
        metavar="PX",
        help="in the data set (default: 50)",
    )
    parser.add_argument(
        "--max-depth", type=float, default=default.max_depth_m, metavar="M", help="of boxes (default: 4.5)"
    )
    for name, text in (
        ("translation_per_m", "deviation of x and y [m] per metre"),
        ("rotation_per_m", "deviation of yaw [rad] per metre"),
        ("rotation_per_rad", "deviation of yaw [rad] per radian"),
    ):
        value = getattr(default.noise, name)
        option = f"--odometry-{name.replace('_', '-')}"
        parser.add_argument(
            option, type=float, default=value, metavar="S", help=f"noise: {text} of a step (default: {value:g})"
        )


def run(arguments: argparse.Namespace, bag: Path) -> None:
    """Import and say what the bag holds; raises InputError."""
    noise = OdometryNoise(
        arguments.odometry_translation_per_m, arguments.odometry_rotation_per_m, arguments.odometry_rotation_per_rad
    )
    settings = ImportSettings(
        arguments.image_width, arguments.max_difficulty, arguments.min_box_height, arguments.max_depth, noise
    )
    if settings.image_width is not None and settings.image_width < 64:
        raise InputError(f"--image-width {settings.image_width}: must be 64 or more")
    result = import_avd(arguments.source, bag, arguments.path, arguments.max_keyframes, arguments.seed, settings)
    print(describe(arguments.out, result, noise))


def describe(bag: Path, result: Imported, noise: OdometryNoise) -> str:
    """A summary of the import for people, in a few lines."""
    skipped = ", ".join(f"{count} {reason}" for reason, count in sorted(result.skipped.items())) or "none"
    rebuilt = f" ({', '.join(result.rebuilt)})" if result.rebuilt else ""
    source = "triangulated from boxes and depth, headings unknown" if result.triangulated else "drawn about the truth"
    return "\n".join(
        (
            f"{bag}: {result.keyframes} keyframes, {result.odometry_samples} odometry samples",
            f"detections: {result.detections}; boxes left out: {skipped}",
            f"images on the path with a rotation rebuilt from their direction: {len(result.rebuilt)}{rebuilt}",
            f"{noise.describe()}; dead reckoning from the true start: ATE {result.dead_reckoning_ate_m:.2f} m",
            f"objects.json: {source}",
        )
    )


def import_avd(
    scene_dir: Path,
    bag: Path,
    path_file: Path | None = None,
    max_keyframes: int | None = None,
    seed: int = 0,
    settings: ImportSettings | None = None,
) -> Imported:
    """Write ``bag`` and its ``objects.json``. Without a path: the scene's ``tour.txt``, or an automatic tour."""
    settings = settings or ImportSettings()
    scene = read_scene(find_scene(scene_dir))
    stops = _limited(_path(scene, path_file, settings), max_keyframes)
    truth = planar_poses(scene, stops)
    odometry = simulate_odometry(truth, settings.noise, _generator(seed, "odometry"))
    objects = true_objects(scene)
    prior = (
        uncertain_prior(objects, _generator(seed, "map_prior"))
        if objects
        else triangulated_prior(scene, settings.max_difficulty)
    )
    with BagWriter(bag) as writer:
        drive = Drive(writer, scene, settings, odometry, truth)
        drive.write_start(objects, _initial_pose(truth[0], _generator(seed, "initial_pose")))
        for index, stop in enumerate(tqdm(stops, desc=scene.folder.name, unit="image")):
            drive.write_stop(index, stop)
    (bag / "objects.json").write_text(prior.to_json() + "\n", encoding="utf-8")
    return Imported(
        keyframes=sum(stop.keyframe for stop in stops),
        odometry_samples=len(stops),
        detections=drive.detections,
        skipped=drive.skipped,
        rebuilt=tuple(stop.name for stop in stops if scene.images[stop.name].rebuilt),
        dead_reckoning_ate_m=dead_reckoning_ate(truth, odometry),
        triangulated=not objects,
    )


def planar_poses(scene: AvdScene, stops: Sequence[Stop]) -> Array:
    """(N, 3) of base_link in map: below the camera, x along its viewing direction."""
    poses = np.array([scene.images[stop.name].T_map_camera for stop in stops])
    return np.column_stack([poses[:, :2, 3], np.arctan2(poses[:, 1, 2], poses[:, 0, 2])])


def dead_reckoning_ate(truth: Array, odometry: Odometry) -> float:
    """Root mean square position error [m] of the odometry laid on from the true first pose."""
    c, s = np.cos(truth[0, 2]), np.sin(truth[0, 2])
    placed = odometry.poses[:, :2] @ np.array([[c, s], [-s, c]]) + truth[0, :2]
    return float(np.sqrt(np.mean(np.sum((placed - truth[:, :2]) ** 2, axis=1))))


def _path(scene: AvdScene, path_file: Path | None, settings: ImportSettings) -> tuple[Stop, ...]:
    tour_file = scene.folder / "tour.txt"
    if path_file is None and not tour_file.is_file():
        return automatic_tour(scene, settings.max_difficulty)
    return read_path(scene, path_file or tour_file)


def _limited(stops: Sequence[Stop], max_keyframes: int | None) -> tuple[Stop, ...]:
    """The path up to its ``max_keyframes``-th keyframe."""
    if max_keyframes is None:
        return tuple(stops)
    if max_keyframes < 1:
        raise InputError(f"--max-keyframes {max_keyframes}: must be 1 or more")
    counts = np.cumsum([stop.keyframe for stop in stops])
    return tuple(stops[: int(np.searchsorted(counts, max_keyframes)) + 1])


def _initial_pose(truth: Array, rng: np.random.Generator) -> Array:
    """(3,) mean of the robot's prior, as far off the true pose as its deviation says."""
    return np.asarray(truth + INITIAL_SIGMA * rng.standard_normal(3))


def _generator(seed: int, purpose: str) -> np.random.Generator:
    return np.random.default_rng([seed, PURPOSES[purpose]])
