"""Folders of pictures become bags of a robot in the plane, however the camera was held."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from worlds.bags.image_folder import hand_held, write_cube_slam, write_seven_scenes
from worlds.bags.imported import messages_of, read_bag

from semantic_slam.cli import import_dataset
from semantic_slam.configuration import from_dict, load_configuration
from semantic_slam.datasets.image_folders.detections import own_boxes
from semantic_slam.datasets.image_folders.images_in_space import drive_in_space
from semantic_slam.datasets.image_folders.journey import journey_by_truth
from semantic_slam.datasets.image_folders.layouts import read_image_folder
from semantic_slam.datasets.space.levelling import OPTICAL
from semantic_slam.errors import InputError
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.geometry import so3
from semantic_slam.geometry.pose import planar_from_pose_vector
from semantic_slam.inference.inputs.spatial_reader import rays_of
from semantic_slam.messages import topics
from semantic_slam.messages.codec import to_message
from semantic_slam.pipeline.assembly.places_assembler import PlacesAssembler
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.shipped import CONFIGURATIONS

PLANAR = np.array([[0.1 * k, 0.05 * k, 0.1 * k - 0.2] for k in range(6)])
PITCHES, ROLLS = [0.35, 0.45, 0.3, 0.5, 0.4, 0.35], [0.1, -0.1, 0.05, 0.0, -0.05, 0.1]
HEIGHTS = [1.4, 1.45, 1.5, 1.45, 1.4, 1.35]
POINTS = np.array([[2.0, 0.3, 0.4], [2.2, -0.5, 0.8]])
LEVEL = np.eye(3)
LEANING = Rotation.from_euler("xyz", [0.4, -0.3, 1.0]).as_matrix()


def poses(R_world_level=LEVEL):
    rows = zip(PLANAR, PITCHES, ROLLS, HEIGHTS, strict=True)
    return [hand_held(planar, pitch, roll, height, R_world_level) for planar, pitch, roll, height in rows]


def imported(source, tmp_path, *words):
    bag = tmp_path / "bag"
    module, arguments = import_dataset.parse(["images", str(source), "--out", str(bag), *words])
    module.run(arguments, bag)
    return bag


def in_first(points):
    """Level positions seen from the first body."""
    c, s = np.cos(PLANAR[0, 2]), np.sin(PLANAR[0, 2])
    return (np.asarray(points)[:, :2] - PLANAR[0, :2]) @ np.array([[c, -s], [s, c]])


def placed_in_map(bag):
    """All detected positions, moved by the true poses."""
    places = []
    known, seen = messages_of(bag, topics.GROUND_TRUTH_ODOMETRY), messages_of(bag, topics.DETECTIONS)
    for true, told in zip(known, seen, strict=True):
        x, y, yaw = planar_from_pose_vector(true.pose)
        rotation = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        places += (told.positions[:, :2] @ rotation.T + [x, y]).tolist()
    return np.array(places)


@pytest.fixture
def folder(tmp_path):
    write_cube_slam(tmp_path / "source", poses(), POINTS)
    return tmp_path / "source"


def test_what_a_pitching_camera_sees_stands_where_it_stands(folder, tmp_path):
    bag = imported(folder, tmp_path, "--drift", "0")
    found = placed_in_map(bag)
    assert len(found) >= 8
    apart = np.linalg.norm(found[:, None] - in_first(POINTS), axis=2).min(axis=1)
    assert apart.max() < 0.02  # a pixel at two metres, rounded


def test_truth_is_in_the_frame_of_its_first_pose_and_odometry_without_noise_agrees(folder, tmp_path):
    bag = imported(folder, tmp_path, "--drift", "0")
    true = planar_from_pose_vector(np.array([row.pose for row in messages_of(bag, topics.GROUND_TRUTH_ODOMETRY)]))
    np.testing.assert_allclose(true[:, :2], in_first(PLANAR), atol=1e-6)
    np.testing.assert_allclose(true[:, 2], PLANAR[:, 2] - PLANAR[0, 2], atol=1e-6)
    told = planar_from_pose_vector(np.array([row.pose for row in messages_of(bag, topics.ODOMETRY)]))
    np.testing.assert_allclose(told, true, atol=1e-6)


def test_noise_of_odometry_is_a_matter_of_seed_and_drift(folder, tmp_path):
    def odometry(name, *words):
        (tmp_path / name).mkdir()
        rows = messages_of(imported(folder, tmp_path / name, *words), topics.ODOMETRY)
        return np.array([row.pose for row in rows])

    first, again = odometry("a", "--seed", "1"), odometry("b", "--seed", "1")
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - odometry("c", "--seed", "2")).max() > 1e-4


def test_a_world_that_leans_is_levelled_by_its_gravity(tmp_path):
    leaning = [LEANING @ point for point in POINTS]
    write_seven_scenes(tmp_path / "source", poses(LEANING), leaning, LEANING @ [0.0, 0.0, -1.0])
    folder = read_image_folder(tmp_path / "source")
    path = journey_by_truth(folder, 0.0, 0).truth
    np.testing.assert_allclose(path.poses[:, :2], in_first(PLANAR), atol=1e-9)
    assert folder.frames[1].time_s == pytest.approx(4.0 / 30.0)
    depth = folder.depth_m(folder.frames[0])
    assert np.isnan(depth[0, 0])  # 65535
    assert np.nanmin(depth) > 1.0


def test_odometry_of_a_file_in_a_frame_of_its_own(folder, tmp_path):
    T_odom_world = np.eye(4)
    T_odom_world[:3, :3], T_odom_world[:3, 3] = LEANING, [3.0, -1.0, 2.0]
    rows = []
    for number, pose in enumerate(poses()):
        moved = T_odom_world @ pose
        row = [100.0 + 0.5 * number, *moved[:3, 3], *Rotation.from_matrix(moved[:3, :3]).as_quat()]
        rows.append(" ".join(f"{value:.9f}" for value in row))
    (folder / "odometry.txt").write_text("\n".join(rows))
    bag = imported(folder, tmp_path)
    told = planar_from_pose_vector(np.array([row.pose for row in messages_of(bag, topics.ODOMETRY)]))
    np.testing.assert_allclose(told[:, :2], in_first(PLANAR), atol=1e-6)


def test_a_box_without_depth_tells_its_bearing_alone(folder, tmp_path):
    import cv2

    for path in (folder / "depth_imgs").iterdir():
        cv2.imwrite(str(path), np.zeros((120, 160), dtype=np.uint16))
    told = messages_of(imported(folder, tmp_path, "--drift", "0"), topics.DETECTIONS)[0]
    assert np.isnan(told.positions).all()
    turned = in_first(POINTS)
    np.testing.assert_allclose(told.bearings_rad, np.arctan2(turned[:, 1], turned[:, 0]), atol=0.02)


def test_the_pipeline_maps_them_in_the_plane(folder, tmp_path):
    bag = imported(folder, tmp_path, "--drift", "0")
    configuration = from_dict({"association": "open", "semantic_model": {"kind": "detector"}})
    summary = run_bag(bag, tmp_path / "beliefs", configuration)
    assert summary.num_keyframes == len(PLANAR)
    assert not summary.dropped
    last = read_record(tmp_path / "beliefs").beliefs[-1]
    there = last.object_poses[last.existence > 0.5][:, :2]
    assert np.linalg.norm(there[:, None] - in_first(POINTS), axis=2).min(axis=0).max() < 0.05


def test_what_is_missing_is_said_in_a_line(folder, tmp_path):
    with pytest.raises(InputError, match="neither frame-"):
        imported(tmp_path, tmp_path)
    with pytest.raises(InputError, match="go together"):
        imported(folder, tmp_path, "--detector", "x.onnx")
    (folder / "camera.txt").write_text("140 140 80 60 640 480\n")
    with pytest.raises(InputError, match="is 160 x 120"):
        read_image_folder(folder)
    (folder / "camera.txt").unlink()
    assert read_image_folder(folder).camera.fx == pytest.approx(535.4)
    (folder / "raw_imgs" / "0009_rgb_raw.jpg").write_bytes(b"")
    with pytest.raises(InputError, match="6 poses for 7 pictures"):
        read_image_folder(folder)


def test_a_folder_without_boxes_asks_for_a_detector(tmp_path):
    write_seven_scenes(tmp_path / "source", poses(), POINTS, [0.0, 0.0, -1.0])
    with pytest.raises(InputError, match="name a detector"):
        imported(tmp_path / "source", tmp_path)


def test_a_camera_that_looks_straight_down_has_no_heading(tmp_path):
    down = hand_held([0.0, 0.0, 0.0], 1.57, 0.0, 1.4, np.eye(3))
    write_cube_slam(tmp_path / "source", [poses()[0], down], POINTS)
    with pytest.raises(InputError, match="frame 1: the camera looks straight"):
        imported(tmp_path / "source", tmp_path)


@pytest.mark.real_data
def test_the_cabinet_stands_still_under_the_true_poses(tmp_path, data_set):
    bag = imported(data_set("cabinet_58"), tmp_path, "--drift", "0", "--depth-to-width", "0.5", "--max-keyframes", "12")
    found = placed_in_map(bag)
    assert len(found) == 12
    assert np.linalg.norm(found - np.median(found, axis=0), axis=1).max() < 0.25  # it is 0.6 m wide


@pytest.mark.real_data
def test_a_detector_finds_the_chairs_of_a_kitchen(tmp_path, data_set):
    weights = data_set("weights")
    words = ("--detector", str(weights / "nanodet_m.onnx"), "--labels-of", str(weights / "coco.names"))
    told = messages_of(imported(data_set("redkitchen"), tmp_path, *words, "--max-keyframes", "3"), topics.DETECTIONS)
    assert all("chair" in row.labels for row in told)
    assert all(np.isfinite(row.positions).all(axis=1).any() for row in told)


def test_in_space_a_folder_keeps_all_six_with_gravity_along_z(tmp_path):
    leaning = [LEANING @ point for point in POINTS]
    write_seven_scenes(tmp_path / "source", poses(LEANING), leaning, LEANING @ [0.0, 0.0, -1.0])
    folder = read_image_folder(tmp_path / "source")
    drive = drive_in_space(folder, None, 0.0, 0)
    height = drive.truth.poses[:, 2]
    np.testing.assert_allclose(height, np.array(HEIGHTS) - HEIGHTS[0], atol=1e-9)
    np.testing.assert_allclose(drive.truth.poses[:, :2], in_first(PLANAR), atol=1e-9)
    ahead = so3.rotated(drive.truth.poses[:, 3:], np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(np.arcsin(-ahead[:, 2]), PITCHES, atol=1e-9)
    np.testing.assert_allclose(drive.start, drive.truth.poses[0], atol=1e-9)


def test_the_pipeline_maps_them_in_space(folder, tmp_path):
    bag = imported(folder, tmp_path, "--drift", "0", "--space")
    summary = run_bag(bag, tmp_path / "beliefs", load_configuration(CONFIGURATIONS / "spatial.yaml"))
    assert summary.num_keyframes >= 3
    last = read_record(tmp_path / "beliefs").beliefs[-1]
    there = last.object_poses[last.existence > 0.5][:, :3]
    points = np.column_stack([in_first(POINTS), POINTS[:, 2] - HEIGHTS[0]])
    assert np.linalg.norm(there[:, None] - points, axis=2).min(axis=0).max() < 0.05


def test_in_space_a_box_without_depth_is_a_ray_that_keeps_its_size(folder, tmp_path):
    """Beside one with depth, and without its picture."""
    import cv2

    first = read_image_folder(folder)
    x_min, y_min, x_max, y_max = own_boxes(first.frames[0], 0).boxes[0].astype(int)
    path = sorted((folder / "depth_imgs").iterdir())[0]
    depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    depth[y_min : y_max + 1, x_min : x_max + 1] = 0
    cv2.imwrite(str(path), depth)
    bag = read_bag(imported(folder, tmp_path, "--drift", "0", "--space"))
    places = PlacesAssembler(load_configuration(CONFIGURATIONS / "spatial.yaml"), lambda _: OPTICAL)
    places.add_camera_info(bag["/camera_info"][0])
    places.add_detections(to_message(bag["/detections"][0]))
    (told,) = places.take()
    assert not places.dropped and np.isfinite(told.ranges_m).tolist() == [False, True]
    assert np.isfinite(told.angular_sizes_rad).all() and np.isfinite(told.place_covariances[0, 1:, 1:]).all()
    apart = poses()[0][:3, :3].T @ (POINTS[0] - poses()[0][:3, 3])
    ahead = so3.rotated(OPTICAL[3:], apart / np.linalg.norm(apart))
    np.testing.assert_allclose(rays_of(told)[0][0], ahead, atol=0.02)
