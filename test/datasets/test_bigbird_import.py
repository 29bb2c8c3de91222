"""A turntable folder in BigBIRD's format becomes the drive of a robot around the object."""

import cv2
import h5py
import numpy as np
import pytest
from worlds.bags.imported import import_bag, read_bag, run_import

from semantic_slam.datasets.bigbird import CAMERAS
from semantic_slam.errors import InputError
from semantic_slam.geometry.pose import rotation_matrix
from semantic_slam.geometry.transform import compose
from semantic_slam.messages.sensor import TransformTree

ANGLES = range(0, 360, 30)
FOCAL, WIDTH, HEIGHT = 100.0, 160, 120
REFERENCE_HEIGHT = 0.9


def table_from_camera(angle_deg, height):
    """A camera 2 m from the axis that looks at the table's origin."""
    azimuth = np.deg2rad(angle_deg)
    position = np.array([2.0 * np.cos(azimuth), 2.0 * np.sin(azimuth), height])
    forward = -position / np.linalg.norm(position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = position
    return pose


@pytest.fixture
def turntable(tmp_path):
    """NP1 is 0.4 m and the reference NP5 0.9 m above the table; the object covers 20 x 20 pixels."""
    folder = tmp_path / "turntables" / "red_mug"
    for sub in ("masks", "poses"):
        (folder / sub).mkdir(parents=True)
    camera_from_reference = np.linalg.inv(table_from_camera(0, 0.4)) @ table_from_camera(0, REFERENCE_HEIGHT)
    with h5py.File(folder / "calibration.h5", "w") as file:
        for camera in CAMERAS:
            for lens in ("rgb", "depth"):
                file[f"{camera}_{lens}_K"] = [[FOCAL, 0, 79.5], [0, FOCAL, 59.5], [0, 0, 1]]
            file[f"{camera}_rgb_d"] = [0.01, 0, 0, 0, 0]
            file[f"{camera}_ir_depth_scale"] = 1.0
            file[f"H_{camera}_from_NP5"] = camera_from_reference if camera == "NP1" else np.eye(4)
    for angle in ANGLES:
        with h5py.File(folder / "poses" / f"NP5_{angle}_pose.h5", "w") as file:
            file["H_table_from_reference_camera"] = table_from_camera(angle, REFERENCE_HEIGHT)
        mask = np.full((HEIGHT, WIDTH), 255, dtype=np.uint8)
        mask[50:70, 70:90] = 0
        cv2.imwrite(str(folder / "masks" / f"NP1_{angle}_mask.pbm"), mask)
        cv2.imwrite(str(folder / f"NP1_{angle}.jpg"), np.full((HEIGHT, WIDTH, 3), angle % 256, dtype=np.uint8))
    return folder


def test_every_view_is_a_frame_with_its_box(turntable, tmp_path, monkeypatch, capsys):
    bag = import_bag(monkeypatch, "bigbird", turntable, "--out", tmp_path / "bag")
    for topic in ("/image/compressed", "/camera_info", "/detections", "/odom", "/ground_truth/odom"):
        assert len(bag[topic]) == len(ANGLES), topic
    np.testing.assert_array_equal(bag["/detections"][3].boxes, [[70, 50, 90, 70]])
    assert bag["/detections"][3].track_ids == ("",)
    assert bag["/ground_truth/associations"][3].object_ids == ("1",)
    assert bag["/ground_truth/objects"][0].class_names == ("red_mug",)
    # by angle, not by name: "120" sorts before "30"
    shades = [cv2.imdecode(image.data, cv2.IMREAD_GRAYSCALE).mean() for image in bag["/image/compressed"]]
    np.testing.assert_allclose(shades, [angle % 256 for angle in ANGLES], atol=2)
    assert "12 views of red_mug from NP1" in capsys.readouterr().out


def test_ground_truth_and_extrinsics_give_the_camera_pose_about_the_object(turntable, tmp_path, monkeypatch):
    bag = import_bag(monkeypatch, "bigbird", turntable, "--out", tmp_path / "bag")
    tree = TransformTree()
    tree.add(bag["/tf_static"][0])
    T_base_camera = tree.lookup("base_link", "camera_optical_frame")
    assert T_base_camera[2] == pytest.approx(0.4)
    for angle, truth in zip(ANGLES, bag["/ground_truth/odom"], strict=True):
        T_map_camera = compose(truth.pose, T_base_camera)
        expected = table_from_camera(angle, 0.4)
        np.testing.assert_allclose(T_map_camera[:3], expected[:3, 3], atol=1e-9)
        np.testing.assert_allclose(rotation_matrix(T_map_camera[3:]), expected[:3, :3], atol=1e-9)
        # the robot stands on the ground, and the object is straight ahead of it
        np.testing.assert_allclose(truth.pose[2:5], 0.0, atol=1e-9)
        ahead = rotation_matrix(truth.pose[3:])[:, 0]
        np.testing.assert_allclose(truth.pose[:3] + 2.0 * ahead, 0.0, atol=1e-9)


def test_max_keyframes_and_a_folder_of_many_objects(turntable, tmp_path, monkeypatch):
    run_import(monkeypatch, "bigbird", turntable.parent, "--out", tmp_path / "bag", "--max-keyframes", 5)
    assert len(read_bag(tmp_path / "bag")["/detections"]) == 5
    (turntable.parent / "blue_mug").mkdir()
    (turntable.parent / "blue_mug" / "calibration.h5").touch()
    with pytest.raises(InputError, match="holds 2 objects; name the folder of one"):
        run_import(monkeypatch, "bigbird", turntable.parent, "--out", tmp_path / "other")


def test_a_camera_without_pictures_is_named(turntable, tmp_path, monkeypatch):
    with pytest.raises(InputError, match=r"no NP3_\*.jpg"):
        run_import(monkeypatch, "bigbird", turntable, "--out", tmp_path / "bag", "--camera", "NP3")
