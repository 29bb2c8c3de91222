"""Range and bearing of a real cabinet, from a detector's boxes and a real depth camera that was carried around it.

58 key frames of TUM RGB-D fr3_cabinet (`cabinet_58`), boxes of YOLOv2, poses from motion capture.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.perception.frame import CameraModel
from semantic_slam.perception.range_bearing import range_and_bearing

pytestmark = pytest.mark.real_data

CAMERA = CameraModel(640, 480, 535.4, 539.2, 320.1, 247.6)
DEPTH_PER_M = 5000.0
HALF_A_WIDTH = PerceptionConfiguration(depth_to_width=0.5)


@dataclass(frozen=True)
class Sight:
    box: np.ndarray  # (4,) pixels
    depth_m: np.ndarray
    T_map_camera: np.ndarray  # (7,) of the optical frame


def sights(folder: Path) -> Iterator[Sight]:
    """Of the frames in which the detector found the cabinet."""
    for index, row in enumerate(np.loadtxt(folder / "truth_cam_poses.txt")):
        found = (folder / "filter_2d_obj_txts" / f"{index:04d}_yolo2_0.15.txt").read_text().split()
        if found:
            x, y, width, height = map(float, found[:4])
            depth = cv2.imread(str(folder / "depth_imgs" / f"{index:04d}_depth_raw.png"), cv2.IMREAD_UNCHANGED)
            yield Sight(np.array([x, y, x + width, y + height]), np.float32(depth / DEPTH_PER_M), row[1:8])


def place(sight: Sight, settings: PerceptionConfiguration) -> np.ndarray:
    """(2,) in the map. The body is where the camera is, turned like the map: a hand has no base frame."""
    T_body_camera = np.concatenate([np.zeros(3), sight.T_map_camera[3:]])
    measured = range_and_bearing(sight.box, sight.depth_m, CAMERA, T_body_camera, settings)
    direction = np.array([np.cos(measured.bearing_rad), np.sin(measured.bearing_rad)])
    return sight.T_map_camera[:2] + measured.range_m * direction


def test_a_cabinet_seen_from_all_around_stands_in_one_place(data_set: Callable[[str], Path]) -> None:
    """Within 15 cm, although boxes, depth and pose all err; the surfaces that it shows lie twice as far apart."""
    seen = list(sights(data_set("cabinet_58")))
    assert len(seen) == 51  # the detector missed it in seven frames
    centres = np.array([place(sight, HALF_A_WIDTH) for sight in seen])
    surfaces = np.array([place(sight, replace(HALF_A_WIDTH, depth_to_width=0.0)) for sight in seen])
    spread, spread_of_surfaces = (np.sqrt(places.var(axis=0).sum()) for places in (centres, surfaces))
    assert spread < 0.15
    assert spread < 0.5 * spread_of_surfaces
