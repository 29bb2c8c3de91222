"""``make_scene``: a simulated room as a scene folder in AVD's format, with its ground truth beside it."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.simulation import avd_writer
from semantic_slam_lab.simulation.annotation import annotate
from semantic_slam_lab.simulation.avd_writer import SceneImage
from semantic_slam_lab.simulation.catalogue import class_named
from semantic_slam_lab.simulation.layout import draw_layout, room
from semantic_slam_lab.simulation.move_graph import moves
from semantic_slam_lab.simulation.mujoco_scene import PlacedObject, scene_xml
from semantic_slam_lab.simulation.renderer import Renderer, camera_model
from semantic_slam_lab.simulation.tour import CAMERA_HEIGHT_M, HORIZONTAL_FOV_RAD, VIEWS_PER_POSITION, drive, ring, tour

UNRECONSTRUCTED_FRACTION = 0.05
SIGMA_POSITION_M = 0.008
SIGMA_YAW_RAD = 0.015
LARGEST_SCENE_NUMBER = 999


@dataclass(frozen=True)
class SceneSettings:
    """Size of the pictures, and whether all views of all positions are rendered or those of the tour alone."""

    width: int = 720
    height: int = 540
    tour_only: bool = False
    goods: int = 0  # pairs of the first so many goods stand in the room; 0: furniture


def make_scene(
    root: Path, seed: int, settings: SceneSettings | None = None, objects: Sequence[PlacedObject] | None = None
) -> Path:
    """Render the room of that seed into ``root/Gen_<seed>_1``; returns the scene's folder. Raises InputError.

    ``objects`` stand in it in place of those that the seed draws.
    """
    settings = settings or SceneSettings()
    if not 0 <= seed <= LARGEST_SCENE_NUMBER:
        raise InputError(f"--seed {seed}: the scene's number has three digits; choose 0 to {LARGEST_SCENE_NUMBER}")
    folder = root / avd_writer.scene_name(seed)
    if folder.exists():
        raise InputError(f"{folder}: exists already; remove it or choose another --out")
    folder.mkdir(parents=True)
    objects = draw_layout(seed, settings.goods) if objects is None else objects
    images = _render(folder, _planned(seed, settings.tour_only), objects, settings)
    scale_mm = float(np.random.default_rng([seed, 4]).uniform(300.0, 900.0))
    avd_writer.write_annotations(folder, images)
    origin = camera_poses(ring(), seed)[0, :3, 3]
    avd_writer.write_image_structs(folder, images, origin, scale_mm)
    avd_writer.write_instances(root, folder, objects)
    _write_tour(folder, seed)
    _write_ground_truth(folder, objects, origin, scale_mm)
    return folder


def camera_poses(positions: Array, seed: int) -> Array:
    """(P * 12, 4, 4) T_map_camera: a robot never stands or turns exactly where it should."""
    rng = np.random.default_rng([seed, 3])
    count = len(positions) * VIEWS_PER_POSITION
    places = np.repeat(positions, VIEWS_PER_POSITION, axis=0) + rng.normal(0.0, SIGMA_POSITION_M, (count, 2))
    yaws = np.arange(count) % VIEWS_PER_POSITION * (2.0 * np.pi / VIEWS_PER_POSITION) + rng.normal(
        0.0, SIGMA_YAW_RAD, count
    )
    return level_cameras(places, yaws)


def level_cameras(places: Array, yaws_rad: Array) -> Array:
    """(N, 4, 4) T_map_camera of optical frames at (N, 2) places that look level into the directions (N,)."""
    zero = np.zeros(len(yaws_rad))
    poses = np.tile(np.eye(4), (len(yaws_rad), 1, 1))
    poses[:, :3, 0] = np.stack([np.sin(yaws_rad), -np.cos(yaws_rad), zero], axis=1)
    poses[:, :3, 1] = [0.0, 0.0, -1.0]
    poses[:, :3, 2] = np.stack([np.cos(yaws_rad), np.sin(yaws_rad), zero], axis=1)
    poses[:, :3, 3] = np.column_stack([places, zero + CAMERA_HEIGHT_M])
    return poses


@dataclass(frozen=True)
class _Planned:
    """An image before it is rendered."""

    name: str
    T_map_camera: Array
    T_map_interpolated: Array
    position: int
    reconstructed: bool
    moves: dict[str, str]


def _planned(seed: int, tour_only: bool) -> list[_Planned]:
    """The images to render; every one is the same whether the others are rendered or not."""
    positions = ring()
    names = [avd_writer.image_name(seed, index) for index in range(len(positions) * VIEWS_PER_POSITION)]
    poses, kept, links = camera_poses(positions, seed), _reconstructed(len(names), seed), moves(names, positions)
    chosen = sorted({frame.image for frame in drive(seed)}) if tour_only else list(range(len(names)))
    rank = {name: index for index, name in enumerate(names)}
    there = {names[index] for index in chosen} | {""}
    return [
        _Planned(
            name=names[index],
            T_map_camera=poses[index],
            T_map_interpolated=(poses[rank[links[index]["rotate_cw"]]] + poses[rank[links[index]["rotate_ccw"]]]) / 2.0,
            position=index // VIEWS_PER_POSITION,
            reconstructed=bool(kept[index]),
            moves={move: target if target in there else "" for move, target in links[index].items()},
        )
        for index in chosen
    ]


def _render(
    folder: Path, planned: Sequence[_Planned], objects: Sequence[PlacedObject], settings: SceneSettings
) -> list[SceneImage]:
    camera = camera_model(settings.width, settings.height, HORIZONTAL_FOV_RAD)
    avd_writer.write_camera(folder, camera, len(planned))
    images = []
    with Renderer(*scene_xml(objects, room()), camera) as renderer:
        for image in tqdm(planned, desc=folder.name, unit="image"):
            view = renderer.render(image.T_map_camera)
            avd_writer.write_pixels(folder, image.name, view.image, view.depth_m)
            found = tuple(annotate(view.body_ids, objects, image.T_map_camera, camera))
            images.append(SceneImage(**vars(image), annotations=found))
    return images


def _reconstructed(count: int, seed: int) -> NDArray[np.bool_]:
    """(count,) false for the images whose pose structure from motion did not find."""
    return np.asarray(np.random.default_rng([seed, 5]).random(count) >= UNRECONSTRUCTED_FRACTION)


def _write_tour(folder: Path, seed: int) -> None:
    """``tour.txt``: the images of a drive past all objects, one name per line."""
    lines = [avd_writer.image_name(seed, frame.image) + "\n" for frame in tour(seed)]
    (folder / "tour.txt").write_text("".join(lines), encoding="utf-8")


def _write_ground_truth(folder: Path, objects: Sequence[PlacedObject], origin: Array, scale_mm: float) -> None:
    """``ground_truth.json``: what AVD lacks. p_map = map_from_world.linear @ p_world + map_from_world.offset."""
    linear, offset = avd_writer.world_from_map(origin, scale_mm)
    inverse = np.linalg.inv(linear)
    rows = [
        {
            "id": placed.object_id,
            "name": placed.name,
            "class": class_named(placed.class_name),
            "pose": placed.pose.tolist(),
            "size": list(placed.model.size),
        }
        for placed in objects
    ]
    truth = {
        "schema_version": 1,
        "frame": "map",
        "map_from_world": {"linear": inverse.tolist(), "offset": (-inverse @ offset).tolist()},
        "objects": rows,
    }
    (folder / "ground_truth.json").write_text(json.dumps(truth, indent=1), encoding="utf-8")
