"""BigBIRD's format: geometry of the rig, masks, depth, and one clear line for what is missing. Nothing here renders."""

from collections.abc import Callable
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
from semantic_slam_lab.simulation.turntable import CAMERAS, table_from_camera, write_mask

from semantic_slam.datasets import bigbird
from semantic_slam.errors import InputError

ANGLES = (0, 90, 210)
SCALE = 0.5


def write_object(folder: Path) -> Path:
    """An object whose pictures are grey and whose mask is one rectangle; written without the simulator's writer."""
    for sub in ("masks", "poses"):
        (folder / sub).mkdir(parents=True)
    reference = table_from_camera(CAMERAS[-1], 0.0)
    with h5py.File(folder / "calibration.h5", "w") as file:
        for camera in CAMERAS:
            for lens in ("rgb_K", "ir_K"):
                file[f"{camera.name}_{lens}"] = np.diag([500.0, 500.0, 1.0])
            file[f"{camera.name}_rgb_d"] = np.zeros(5)
            file[f"{camera.name}_ir_depth_scale"] = SCALE
            file[f"H_{camera.name}_from_NP5"] = np.linalg.inv(table_from_camera(camera, 0.0)) @ reference
    mask = np.zeros((24, 33), dtype=bool)  # rows of 33 bits end within a byte
    mask[5:11, 7:20] = True
    for angle in ANGLES:
        with h5py.File(folder / "poses" / f"NP5_{angle}_pose.h5", "w") as file:
            file["H_table_from_reference_camera"] = table_from_camera(CAMERAS[-1], np.deg2rad(angle))
            file["board_frame_offset"] = np.zeros(3)
        for camera in CAMERAS:
            stem = f"{camera.name}_{angle}"
            cv2.imwrite(str(folder / f"{stem}.jpg"), np.full((24, 33, 3), (200, 100, 50), dtype=np.uint8))
            write_mask(folder / "masks" / f"{stem}_mask.pbm", mask)
            with h5py.File(folder / f"{stem}.h5", "w") as file:
                file["depth"] = np.where(mask, 20000, 0).astype(np.uint16)
    return folder


def test_viewpoint_is_where_the_camera_stands_in_the_table_frame(tmp_path: Path) -> None:
    """For every camera, through its transform from NP5: azimuth = table angle, elevation and range of its ring."""
    write_object(tmp_path / "crate")
    rings = {camera.name: camera for camera in CAMERAS}
    views = list(bigbird.turntable_views(tmp_path / "crate"))
    assert [(view.camera, view.angle_deg) for view in views] == [(name, a) for name in bigbird.CAMERAS for a in ANGLES]
    for view in views:
        azimuth, elevation, distance = view.viewpoint
        assert np.exp(1j * azimuth) == pytest.approx(np.exp(1j * np.deg2rad(view.angle_deg)))
        assert elevation == pytest.approx(rings[view.camera].elevation_rad)
        assert distance == pytest.approx(rings[view.camera].range_m)


def test_camera_looks_at_the_object() -> None:
    """The table's origin lies on the optical axis, at the camera's range; up in the picture is up in the world."""
    for camera in CAMERAS:
        pose = table_from_camera(camera, 2.0)
        np.testing.assert_allclose(np.linalg.inv(pose) @ [0, 0, 0, 1], [0, 0, camera.range_m, 1], atol=1e-12)
        assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
        assert pose[2, 1] < 0.0  # y of the optical frame points down


def test_picture_mask_box_and_depth(tmp_path: Path) -> None:
    view = next(bigbird.turntable_views(write_object(tmp_path / "crate"), ("NP2",)))
    np.testing.assert_allclose(view.image[0, 0], [50, 100, 200], atol=3)  # RGB
    np.testing.assert_array_equal(view.box, [7, 5, 20, 11])
    assert view.mask.sum() == 6 * 13
    assert view.depth_m[6, 8] == pytest.approx(20000 * 1e-4 * SCALE)
    assert np.isnan(view.depth_m[0, 0])
    assert view.object_name == "crate"


@pytest.mark.parametrize(
    ("file", "fault"),
    [
        ("calibration.h5", "NP1_rgb_K"),
        ("poses/NP5_90_pose.h5", "H_table_from_reference_camera"),
        ("masks/NP1_0_mask.pbm", "missing"),
        ("NP1_0.jpg", "missing"),
        ("NP1_0.h5", "depth"),
    ],
)
def test_missing_piece_is_named(tmp_path: Path, file: str, fault: str) -> None:
    folder = write_object(tmp_path / "crate")
    views = list(bigbird.turntable_views(folder, ("NP1",)))
    (folder / file).unlink()
    with pytest.raises(InputError, match=fault) as caught:
        list(bigbird.turntable_views(folder, ("NP1",)))
        _ = views[0].image, views[0].mask, views[0].depth_m
    assert Path(file).name in str(caught.value)


@pytest.mark.parametrize(
    ("make", "fault"),
    [
        (lambda file: file.create_dataset("depth", (40_000, 40_000), "u2", compression="gzip"), "more than 100000000"),
        (lambda file: file.create_dataset("depth", (10_000, 10_000), ("f8", (1000, 1000))), "more than 100000000"),
        (lambda file: file.create_dataset("depth", data=np.zeros(10)), "'depth' is no picture"),
        (lambda file: file.create_dataset("depth", data=np.zeros((2, 2), dtype=complex)), "no readable 'depth'"),
        (lambda file: file.create_group("depth"), "no readable 'depth'"),
        (lambda file: file.create_dataset("depth", data=b"deep"), "no readable 'depth'"),
        (lambda file: file.create_dataset("depth", data=h5py.Empty("f")), "no readable 'depth'"),
    ],
)
def test_depth_that_is_no_picture_is_named(tmp_path: Path, make: Callable[[h5py.File], object], fault: str) -> None:
    """3 GB of zeros take kilobytes of a file."""
    view = next(bigbird.turntable_views(write_object(tmp_path / "crate"), ("NP1",)))
    with h5py.File(view.folder / "NP1_0.h5", "w") as file:
        make(file)
    with pytest.raises(InputError, match=rf"NP1_0\.h5: .*{fault}"):
        _ = view.depth_m


def test_a_camera_that_is_nowhere_is_named(tmp_path: Path) -> None:
    folder = write_object(tmp_path / "crate")
    with h5py.File(folder / "calibration.h5", "r+") as file:
        file["H_NP1_from_NP5"][...] = 0.0
    with pytest.raises(InputError, match=r"calibration\.h5: 'H_NP1_from_NP5' is no motion; restore"):
        next(bigbird.turntable_views(folder, ("NP1",)))


def test_empty_mask_is_named(tmp_path: Path) -> None:
    folder = write_object(tmp_path / "crate")
    write_mask(folder / "masks" / "NP1_0_mask.pbm", np.zeros((24, 33), dtype=bool))
    with pytest.raises(InputError, match="NP1_0_mask"):
        _ = next(bigbird.turntable_views(folder, ("NP1",))).box


def test_camera_without_pictures_is_named(tmp_path: Path) -> None:
    folder = write_object(tmp_path / "crate")
    for path in folder.glob("NP3_*.jpg"):
        path.unlink()
    with pytest.raises(InputError, match="NP3"):
        list(bigbird.turntable_views(folder))


def test_object_folders(tmp_path: Path) -> None:
    crate, chest = write_object(tmp_path / "crate"), write_object(tmp_path / "chest")
    assert bigbird.object_folders(tmp_path) == (chest, crate)
    assert bigbird.object_folders(crate) == (crate,)
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="calibration"):
        bigbird.object_folders(tmp_path / "empty")
