"""Boxes of the objects in a rendered view, with AVD's difficulty from 1 (easy) to 5."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array
from semantic_slam.perception.frame import CameraModel
from semantic_slam_lab.simulation.mujoco_scene import PlacedObject

LEAST_SIDE_PX = 12
LEAST_VISIBLE_FRACTION = 0.05
DIFFICULTY_BELOW = ((0.9, 1), (0.75, 2), (0.5, 3), (0.25, 4))
"""AVD's difficulty of a box by its visible fraction, (least fraction, difficulty); below the last it is 5."""
SMALL_BOX_PX = 40
NEAREST_CORNER_M = 0.05


@dataclass(frozen=True)
class Annotation:
    """An object's box in one image."""

    object_id: int
    box: tuple[int, int, int, int]  # x_min y_min x_max y_max, pixels, of what is visible
    difficulty: int

    def row(self) -> list[int]:
        """AVD's list of six."""
        return [*self.box, self.object_id, self.difficulty]


def annotate(
    body_ids: NDArray[np.int32], objects: Sequence[PlacedObject], T_map_camera: Array, camera: CameraModel
) -> list[Annotation]:
    """Annotations of a view; body ``i + 1`` is ``objects[i]``."""
    found = []
    for body, placed in enumerate(objects, start=1):
        mask = body_ids == body
        pixels = int(mask.sum())
        if not pixels:
            continue
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        box = (int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)
        side = min(box[2] - box[0], box[3] - box[1])
        fraction = pixels / _silhouette_px(placed, T_map_camera, camera)
        if side >= LEAST_SIDE_PX and fraction >= LEAST_VISIBLE_FRACTION:
            found.append(Annotation(placed.object_id, box, difficulty(fraction, side)))
    return found


def difficulty(visible_fraction: float, shorter_side_px: int) -> int:
    """1..5; small boxes are one step harder."""
    level = next((level for least, level in DIFFICULTY_BELOW if visible_fraction >= least), 5)
    return min(level + (shorter_side_px < SMALL_BOX_PX), 5)


def corners(placed: PlacedObject) -> Array:
    """(8, 3) corners of the object in map."""
    signs = np.stack(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5]), axis=-1).reshape(-1, 3)
    local = signs * np.array(placed.model.size)
    c, s = np.cos(placed.yaw_rad), np.sin(placed.yaw_rad)
    return np.asarray(local @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]).T + placed.pose[:3])


def _silhouette_px(placed: PlacedObject, T_map_camera: Array, camera: CameraModel) -> float:
    """Area that the object would cover if nothing hid it and the image had no border; infinite when it is too near."""
    points = (corners(placed) - T_map_camera[:3, 3]) @ T_map_camera[:3, :3]
    if points[:, 2].min() < NEAREST_CORNER_M:
        return float("inf")
    pixels = points[:, :2] / points[:, 2:] * [camera.fx, camera.fy]
    return float(cv2.contourArea(cv2.convexHull(pixels.astype(np.float32))))
