"""Scenes in the format of the Active Vision Dataset, the real ones and those of ``make_scene``.

Poses become metric in a map frame with z up: map's x is the world's x, and z = 0 is the floor. An image that the
data set's structure from motion did not reconstruct has no rotation, only an interpolated position and direction; its
rotation is rebuilt from the direction, level as all cameras of the scene are. One without even these is dropped.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from semantic_slam.datasets.avd.matlab_file import read_matlab, unreadable
from semantic_slam.datasets.avd.poses import downwards, map_axes, map_pose, world_pose
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages.picture_files import read_picture
from semantic_slam.perception.frame import CameraModel

MOVES = ("forward", "backward", "left", "right", "rotate_cw", "rotate_ccw")
CAMERA_LINE = 3
BACKGROUND_ID = 0
UNKNOWN_DIFFICULTY = 5
MILLIMETRES = 1000.0
FLOOR_IMAGES = 12
FLOOR_BIN_M = 0.02
LEAST_CAMERA_HEIGHT_M = 0.3


@dataclass(frozen=True)
class AvdImage:
    """One image: where it was taken, what is in it, and where a robot can go from it."""

    name: str
    T_map_camera: Array  # (4, 4) of the optical frame
    rebuilt: bool  # the rotation comes from the direction alone
    boxes: Array  # (N, 4) x_min y_min x_max y_max, pixels
    instance_ids: NDArray[np.int64]  # (N,)
    difficulties: NDArray[np.int64]  # (N,) 1..5
    moves: Mapping[str, str]  # move -> image name, only those that lead somewhere


@dataclass(frozen=True)
class AvdScene:
    """A scene without its pixels, which are read image by image."""

    folder: Path
    camera: CameraModel
    images: Mapping[str, AvdImage]  # by name, in the order of the names
    instance_names: Mapping[int, str]
    rebuilt: tuple[str, ...]  # images whose rotation was rebuilt from the direction
    dropped: tuple[str, ...]  # images without any pose

    @property
    def colour_path(self) -> Path:
        return self.folder / "jpg_rgb"

    def depth_path(self, name: str) -> Path:
        """Depth picture that belongs to an image: the last two digits are 03."""
        return self.folder / "high_res_depth" / f"{Path(name).stem[:-2]}03.png"

    def image(self, name: str) -> NDArray[np.uint8]:
        """(height, width, 3) RGB picture of an image of the scene."""
        return np.ascontiguousarray(read_picture(self.colour_path / name, cv2.IMREAD_COLOR)[..., ::-1])

    def depth_m(self, name: str) -> NDArray[np.float32]:
        """(height, width) metres along the optical axis, NaN where invalid."""
        millimetres = read_picture(self.depth_path(name), cv2.IMREAD_UNCHANGED)
        return np.where(millimetres == 0, np.nan, millimetres / MILLIMETRES).astype(np.float32)


def find_scene(folder: Path) -> Path:
    """The scene's folder: ``folder`` itself, or the only scene in a data set's root. Raises InputError."""
    if (folder / "annotations.json").is_file():
        return folder
    scenes = sorted(path.parent for path in folder.glob("*/annotations.json"))
    if len(scenes) == 1:
        return scenes[0]
    found = f"holds the scenes {', '.join(path.name for path in scenes)}" if scenes else "no annotations.json there"
    raise InputError(f"{folder}: {found}; name one scene's folder in AVD's layout")


def read_scene(folder: Path) -> AvdScene:
    """A scene; raises InputError that names the file which is missing or damaged."""
    annotations = _read_json(folder / "annotations.json")
    records, scale_mm = _read_structs(folder / "image_structs.mat")
    cameras = {name: pose for name, pose in ((_text(record["image_name"]), world_pose(record)) for record in records)}
    known = {name: pose for name, pose in cameras.items() if pose is not None and name in annotations}
    if not known:
        raise InputError(
            f"{folder}: no image of annotations.json has a pose in image_structs.mat; are they of one scene?"
        )
    down = downwards([rotation for rotation, _, _ in known.values() if rotation is not None], folder)
    axes = map_axes(down)
    poses = {name: map_pose(pose, axes, down, scale_mm / MILLIMETRES) for name, pose in sorted(known.items())}
    images = {
        name: _image(folder, name, pose, known[name][0] is None, annotations[name], known)
        for name, pose in poses.items()
    }
    rebuilt = tuple(name for name, image in images.items() if image.rebuilt)
    dropped = tuple(sorted(name for name in annotations if name not in known))
    scene = AvdScene(folder, _read_camera(folder), images, _instance_names(folder), rebuilt, dropped)
    return _on_floor(scene)


def _image(folder: Path, name: str, pose: Array, rebuilt: bool, entry: Any, known: Mapping[str, Any]) -> AvdImage:
    try:
        rows = [row for row in entry["bounding_boxes"] if row[4] != BACKGROUND_ID]
        table = np.array([[*row, UNKNOWN_DIFFICULTY][:6] for row in rows], dtype=np.float64).reshape(-1, 6)
        moves = {move: entry[move] for move in MOVES if entry[move] in known}
    except (KeyError, TypeError, IndexError, ValueError) as fault:
        raise InputError(f"{folder / 'annotations.json'}: {name} is damaged ({fault!r}); restore the file") from None
    ids, difficulties = table[:, 4].astype(np.int64), table[:, 5].astype(np.int64)
    return AvdImage(name, pose, rebuilt, table[:, :4], ids, difficulties, moves)


def _on_floor(scene: AvdScene) -> AvdScene:
    """The scene with its floor at z = 0, or in the frame of its ground truth where a simulator wrote one."""
    truth = scene.folder / "ground_truth.json"
    first = next(iter(scene.images.values()))
    shift = _true_shift(truth, scene) if truth.is_file() else np.array([0.0, 0.0, -floor_height(scene)])
    if not np.isfinite(shift).all():
        raise InputError(f"{scene.folder}: {first.name} and others show no floor; is high_res_depth complete?")
    move = np.eye(4)
    move[:3, 3] = shift
    images = {
        name: AvdImage(**{**vars(image), "T_map_camera": move @ image.T_map_camera})
        for name, image in scene.images.items()
    }
    return AvdScene(**{**vars(scene), "images": images})


def _true_shift(path: Path, scene: AvdScene) -> Array:
    """What the map of ``ground_truth.json`` is shifted by against the world's origin."""
    try:
        return np.array(_read_json(path)["map_from_world"]["offset"], dtype=np.float64).reshape(3)
    except (KeyError, TypeError, ValueError) as fault:
        raise InputError(f"{path}: map_from_world is damaged ({fault!r}); render {scene.folder.name} again") from None


def floor_height(scene: AvdScene) -> float:
    """Height [m] of the lowest large plane below the cameras, from the depth of some images; NaN when none shows it."""
    names = list(scene.images)[:: max(1, len(scene.images) // FLOOR_IMAGES)]
    heights = np.concatenate(
        [_heights(scene, name) for name in names if scene.depth_path(name).is_file()] or [np.zeros(0)]
    )
    camera = float(np.median([image.T_map_camera[2, 3] for image in scene.images.values()]))
    low = heights[heights < camera - LEAST_CAMERA_HEIGHT_M]
    if not len(low):
        return float("nan")
    bins = np.round(low / FLOOR_BIN_M).astype(np.int64)
    values, counts = np.unique(bins, return_counts=True)
    return float(np.median(low[np.abs(bins - values[np.argmax(counts)]) <= 1]))


def _heights(scene: AvdScene, name: str) -> Array:
    """Heights in map of every eighth pixel that has depth."""
    depth = scene.depth_m(name)[::8, ::8].astype(np.float64)
    rows, columns = np.meshgrid(*(np.arange(size) * 8.0 for size in depth.shape), indexing="ij")
    camera, pose = scene.camera, scene.images[name].T_map_camera
    x, y = (columns - camera.cx) / camera.fx * depth, (rows - camera.cy) / camera.fy * depth
    heights = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * depth + pose[2, 3]
    return np.asarray(heights[np.isfinite(heights)])


def _read_structs(path: Path) -> tuple[Any, float]:
    """Records and scale [mm] of ``image_structs.mat``."""
    content = read_matlab(path)
    try:
        return content["image_structs"][0], float(content["scale"][0][0])
    except (ValueError, KeyError, IndexError, TypeError) as fault:
        raise unreadable(path, fault) from None


def _read_camera(folder: Path) -> CameraModel:
    """Intrinsics from ``cameras.txt`` of the scene, or of ``camera_params/<scene>`` beside it."""
    places = (folder / "cameras.txt", folder.parent / "camera_params" / folder.name / "cameras.txt")
    path = next((place for place in places if place.is_file()), None)
    if path is None:
        raise InputError(f"{places[0]}: missing, as is {places[1]}; restore one of them from the data set")
    try:
        words = path.read_text(encoding="utf-8").splitlines()[CAMERA_LINE].split()[2:12]
        width, height, *numbers = (float(word) for word in words)
        fx, fy, cx, cy, *distortion = numbers
    except (IndexError, ValueError) as fault:
        raise InputError(
            f"{path}: line {CAMERA_LINE + 1} is no camera ({fault}); restore it from the data set"
        ) from None
    return CameraModel(int(width), int(height), fx, fy, cx, cy, tuple(distortion) if any(distortion) else ())


def _instance_names(folder: Path) -> dict[int, str]:
    """Instance id -> name from the root's ``instance_id_map.txt``; {} where there is none."""
    path = folder.parent / "instance_id_map.txt"
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    try:
        return {int(number): name for name, number in (line.split() for line in lines if line.strip())}
    except ValueError:
        raise InputError(f"{path}: every line must be a name and a number; restore it from the data set") from None


def _read_json(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as fault:
        raise InputError(f"{path}: not readable ({fault}); restore it from the data set") from None


def _text(value: Any) -> str:
    """A MATLAB string, which comes wrapped in arrays."""
    return str(np.asarray(value).ravel()[0])
