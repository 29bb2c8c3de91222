"""AVD's on-disk format, written: names, images, depth, annotations with the move graph, poses, cameras.

The world of the files is that of a structure-from-motion system: its floor is x-z, y points down, its origin is
the first camera and its unit is arbitrary (``scale`` millimetres).
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from semantic_slam.geometry.arrays import Array
from semantic_slam.perception.frame import CameraModel
from semantic_slam_lab.simulation.annotation import Annotation
from semantic_slam_lab.simulation.mujoco_scene import PlacedObject

SCENE_TYPE = "2"  # Gen
SCAN = "1"
WORLD_FROM_MAP_ROTATION = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
MOVES = ("rotate_ccw", "rotate_cw", "forward", "backward", "left", "right")
JPEG_QUALITY = 92
MAT_HEADER = b"MATLAB 5.0 MAT-file".ljust(116)
"""Free text of 116 bytes; scipy puts the date there, and the same scene would not be the same file."""
STRUCT_FIELDS = (
    *(
        "image_name",
        "t",
        "R",
        "world_pos",
        "direction",
        "quat",
        "scaled_world_pos",
        "image_id",
        "camera_id",
        "cluster_id",
    ),
    *("rotate_cw", "rotate_ccw", "translate_forward", "translate_backward", "translate_right", "translate_left"),
)
MOVE_OF_FIELD = {field: field.removeprefix("translate_") for field in STRUCT_FIELDS[10:]}


@dataclass(frozen=True)
class SceneImage:
    """One image of the scene beside its pixels."""

    name: str  # 15 digits and .jpg
    T_map_camera: Array  # (4, 4)
    T_map_interpolated: (
        Array  # (4, 4) the mean of its neighbours' poses: all that is told when it was not reconstructed
    )
    position: int  # images of one position share it
    reconstructed: bool
    moves: Mapping[str, str]  # move -> name or ""
    annotations: tuple[Annotation, ...]


def scene_name(number: int) -> str:
    """Folder of a generated scene."""
    return f"Gen_{number:03d}_{SCAN}"


def image_name(scene: int, index: int) -> str:
    """15 digits: type, scene, scan, image index, 01 for colour."""
    return f"{SCENE_TYPE}{scene:03d}{SCAN}{index:06d}" + "01" + "01.jpg"


def depth_name(name: str) -> str:
    """Depth picture of an image: its last two digits are 03."""
    return f"{Path(name).stem[:-2]}03.png"


def write_pixels(folder: Path, name: str, image: NDArray[np.uint8], depth_m: NDArray[np.float32]) -> None:
    """``jpg_rgb`` and ``high_res_depth`` of one image, whose depth ends below 65 m."""
    (folder / "jpg_rgb").mkdir(parents=True, exist_ok=True)
    (folder / "high_res_depth").mkdir(exist_ok=True)
    colours = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    cv2.imwrite(str(folder / "jpg_rgb" / name), colours, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    millimetres = np.nan_to_num(np.round(depth_m * 1000.0), nan=0.0)
    cv2.imwrite(str(folder / "high_res_depth" / depth_name(name)), millimetres.astype(np.uint16))


def write_annotations(folder: Path, images: Sequence[SceneImage]) -> None:
    """``annotations.json``."""
    table = {
        image.name: {"bounding_boxes": [found.row() for found in image.annotations]}
        | {move: image.moves[move] for move in MOVES}
        for image in images
    }
    (folder / "annotations.json").write_text(json.dumps(table), encoding="utf-8")


def write_instances(root: Path, folder: Path, objects: Sequence[PlacedObject]) -> None:
    """The root's ``instance_id_map.txt`` and the scene's ``present_instance_names.txt``."""
    (root / "instance_id_map.txt").write_text("".join(f"{placed.name} {placed.object_id}\n" for placed in objects))
    (folder / "present_instance_names.txt").write_text("".join(f"{placed.name}\n" for placed in objects))


def write_camera(folder: Path, camera: CameraModel, number_of_images: int) -> None:
    """``cameras.txt``: three lines of comment, then id, model, size, intrinsics and distortion."""
    distortion = (*camera.distortion, 0.0, 0.0, 0.0, 0.0)[:4]
    numbers = " ".join(f"{value:.9g}" for value in (camera.fx, camera.fy, camera.cx, camera.cy, *distortion))
    (folder / "cameras.txt").write_text(
        "# One camera per line\n"
        "#   id, model, width, height, fx, fy, cx, cy, k1, k2, p1, p2\n"
        f"# It took {number_of_images} images\n"
        f"1 OPENCV {camera.width} {camera.height} {numbers}\n"
    )


def world_from_map(origin: Array, scale_mm: float) -> tuple[Array, Array]:
    """(3, 3) times (3,) plus (3,): a point of map in the files' world, whose origin is at (3,) in map."""
    linear = WORLD_FROM_MAP_ROTATION * (1000.0 / scale_mm)
    return linear, -linear @ origin


def write_image_structs(folder: Path, images: Sequence[SceneImage], origin: Array, scale_mm: float) -> None:
    """``image_structs.mat`` with the world's origin at (3,) in map; R and t are empty where none was found."""
    linear, offset = world_from_map(origin, scale_mm)
    records = np.zeros((1, len(images)), dtype=[(field, object) for field in STRUCT_FIELDS])
    by_name = {image.name: number for number, image in enumerate(images, start=1)}
    for index, image in enumerate(images):
        rotation = (WORLD_FROM_MAP_ROTATION @ image.T_map_camera[:3, :3]).T  # X_cam = R X_world + t
        known = image.T_map_camera if image.reconstructed else image.T_map_interpolated
        position, direction = linear @ known[:3, 3] + offset, WORLD_FROM_MAP_ROTATION @ known[:3, 2]
        record = records[0, index]
        empty = np.zeros((0, 0))
        record["image_name"] = image.name
        record["R"] = rotation if image.reconstructed else empty
        record["t"] = (-rotation @ position)[:, None] if image.reconstructed else empty
        record["quat"] = Rotation.from_matrix(rotation).as_quat()[[3, 0, 1, 2], None] if image.reconstructed else empty
        record["world_pos"] = position[:, None]
        record["direction"] = direction[:, None] / np.linalg.norm(direction)
        record["scaled_world_pos"] = position[:, None] * scale_mm
        record["image_id"], record["camera_id"], record["cluster_id"] = by_name[image.name], 1, image.position
        for field, move in MOVE_OF_FIELD.items():
            record[field] = image.moves[move]
    savemat(folder / "image_structs.mat", {"image_structs": records, "scale": scale_mm}, do_compression=True)
    with (folder / "image_structs.mat").open("r+b") as file:
        file.write(MAT_HEADER)
