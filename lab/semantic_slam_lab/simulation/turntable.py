"""Turntable views of furniture or goods, written in BigBIRD's on-disk format (see datasets/bigbird.py)."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import h5py
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from semantic_slam.geometry.arrays import Array
from semantic_slam.perception.frame import CameraModel
from semantic_slam_lab.simulation.catalogue import model_named
from semantic_slam_lab.simulation.mujoco_scene import PlacedObject, scene_xml
from semantic_slam_lab.simulation.renderer import Renderer, Rendering, camera_model

DEPTH_SCALE = 1.0
"""``ir_depth_scale``: depth in metres is raw * 1e-4 * DEPTH_SCALE."""


@dataclass(frozen=True)
class TurntableCamera:
    """A camera of the turntable, one of five on one side of the table."""

    name: str
    range_m: float  # from the object's centre
    elevation_rad: float


CAMERAS = (
    TurntableCamera("NP1", 3.2, np.deg2rad(9.0)),
    TurntableCamera("NP2", 2.5, np.deg2rad(11.5)),
    TurntableCamera("NP3", 2.0, np.deg2rad(15.0)),
    TurntableCamera("NP4", 1.7, np.deg2rad(18.0)),
    TurntableCamera("NP5", 2.1, np.deg2rad(35.0)),
)
"""NP1 is the lowest ring; NP1 to NP4 are what a camera 0.9 m above the floor sees from those distances."""


@dataclass(frozen=True)
class TurntableSettings:
    step_deg: int = 3
    width: int = 320
    height: int = 240
    horizontal_fov_rad: float = float(np.deg2rad(52.0))


def write_turntables(root: Path, names: Sequence[str], settings: TurntableSettings | None = None) -> tuple[Path, ...]:
    """One folder ``root/<name>`` per model of the catalogue; returns them."""
    settings = settings or TurntableSettings()
    angles = range(0, 360, settings.step_deg)
    with tqdm(total=len(names) * len(angles), desc="turntables", unit="angle") as progress:
        for name in names:
            _write_object(root / name, name, angles, settings, progress)
    return tuple(root / name for name in names)


def table_from_camera(camera: TurntableCamera, azimuth_rad: float) -> Array:
    """(4, 4) pose of a camera that looks at the table's origin; the table frame is the object frame."""
    azimuth, elevation = azimuth_rad, camera.elevation_rad
    towards = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(-towards, right), -towards], axis=1)
    pose[:3, 3] = camera.range_m * towards
    return pose


def _write_object(folder: Path, name: str, angles: range, settings: TurntableSettings, progress: "tqdm[None]") -> None:
    for sub in ("masks", "poses"):
        (folder / sub).mkdir(parents=True, exist_ok=True)
    intrinsics = camera_model(settings.width, settings.height, settings.horizontal_fov_rad)
    _write_calibration(folder / "calibration.h5", intrinsics)
    height = model_named(name).size[2]
    xml, assets = scene_xml([PlacedObject(1, name, name, 0.0, 0.0, 0.0)], room=None)
    world_from_table = np.eye(4)
    world_from_table[2, 3] = height / 2.0
    with Renderer(xml, assets, intrinsics) as renderer:
        for angle in angles:
            for camera in CAMERAS:
                view = renderer.render(world_from_table @ table_from_camera(camera, np.deg2rad(angle)))
                _write_view(folder, f"{camera.name}_{angle}", view)
            _write_pose(folder / "poses" / f"NP5_{angle}_pose.h5", table_from_camera(CAMERAS[-1], np.deg2rad(angle)))
            progress.update()


def _write_view(folder: Path, stem: str, view: Rendering) -> None:
    mask = view.body_ids == 1
    cv2.imwrite(
        str(folder / f"{stem}.jpg"), cv2.cvtColor(view.image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 92]
    )
    raw = np.where(mask, np.round(np.nan_to_num(view.depth_m) * 1e4 / DEPTH_SCALE), 0).astype(np.uint16)
    with h5py.File(folder / f"{stem}.h5", "w") as file:
        file.create_dataset("depth", data=raw, compression="gzip", compression_opts=1)
    write_mask(folder / "masks" / f"{stem}_mask.pbm", mask)


def write_mask(path: Path, mask: NDArray[np.bool_]) -> None:
    """Portable bitmap in which the object is black, which that format writes as bit 1."""
    height, width = mask.shape
    path.write_bytes(f"P4\n{width} {height}\n".encode() + np.packbits(mask, axis=1).tobytes())


def _write_calibration(path: Path, intrinsics: CameraModel) -> None:
    """Every camera sees colour and depth through one lens; the rig's reference is NP5."""
    matrix = np.array([[intrinsics.fx, 0, intrinsics.cx], [0, intrinsics.fy, intrinsics.cy], [0, 0, 1.0]])
    table_from_reference = table_from_camera(CAMERAS[-1], 0.0)
    with h5py.File(path, "w") as file:
        for camera in CAMERAS:
            camera_from_reference = np.linalg.inv(table_from_camera(camera, 0.0)) @ table_from_reference
            for lens in ("rgb", "depth", "ir"):
                file[f"{camera.name}_{lens}_K"] = matrix
                file[f"{camera.name}_{lens}_d"] = np.zeros(5)
            file[f"{camera.name}_ir_depth_scale"] = DEPTH_SCALE
            file[f"H_{camera.name}_from_NP5"] = camera_from_reference
            file[f"H_{camera.name}_ir_from_NP5"] = camera_from_reference


def _write_pose(path: Path, table_from_reference: Array) -> None:
    with h5py.File(path, "w") as file:
        file["H_table_from_reference_camera"] = table_from_reference
        file["board_frame_offset"] = np.zeros(3)
