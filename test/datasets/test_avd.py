"""AVD's format: what is written in it is read back, traps included, and becomes a bag. Nothing here renders."""

import json
import struct
import zlib
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.io import loadmat, savemat
from semantic_slam_lab.simulation import avd_writer
from semantic_slam_lab.simulation.annotation import Annotation
from semantic_slam_lab.simulation.avd_writer import SceneImage
from semantic_slam_lab.simulation.move_graph import moves
from semantic_slam_lab.simulation.mujoco_scene import PlacedObject
from semantic_slam_lab.simulation.renderer import camera_model
from semantic_slam_lab.simulation.scene import camera_poses

from semantic_slam.bag.reader import BagReader
from semantic_slam.datasets.avd import avd_import
from semantic_slam.datasets.avd import path as avd_path
from semantic_slam.datasets.avd import scene as avd
from semantic_slam.datasets.avd.matlab_file import read_matlab
from semantic_slam.datasets.avd.objects import POSITION_VARIANCE_M2, triangulated_prior
from semantic_slam.datasets.planar_odometry import OdometryNoise, simulate_odometry, step_sigma
from semantic_slam.errors import InputError
from semantic_slam.geometry.pose import planar_from_pose_vector
from semantic_slam.inference.world.map_prior import read_map_prior

HEIGHT_M = 0.9
SCALE_MM = 437.0
ORIGIN = np.array([0.7, -0.4, HEIGHT_M])
POSITIONS = np.array([[0.0, 0.0], [0.3, 0.0], [0.6, 0.0]])
UNRECONSTRUCTED = 5
CAMERA = camera_model(64, 48, np.deg2rad(80.0))
OBJECTS = (PlacedObject(1, "crate_1", "crate", 2.0, 0.3, 1.0), PlacedObject(2, "desk_1", "desk", -2.0, -0.2, 0.4))


def floor_depth(pose: np.ndarray) -> np.ndarray:
    """Depth picture of a camera above an endless floor: z_c with height + pose_z . ray * z_c = 0, nothing above it."""
    rows, columns = np.meshgrid(np.arange(48.0), np.arange(64.0), indexing="ij")
    rays = np.stack([(columns - CAMERA.cx) / CAMERA.fx, (rows - CAMERA.cy) / CAMERA.fy, np.ones_like(rows)], axis=-1)
    down = -(rays @ pose[2, :3])
    with np.errstate(divide="ignore"):
        return np.where(down > 0.05, pose[2, 3] / down, np.nan).astype(np.float32)


def write_scene(root: Path) -> tuple[Path, np.ndarray]:
    """Three positions of twelve views whose only pixels are the floor's; returns the folder and the true poses."""
    folder = root / avd_writer.scene_name(7)
    names = [avd_writer.image_name(7, index) for index in range(36)]
    poses, links = camera_poses(POSITIONS, 0), moves(names, POSITIONS)
    images = []
    for index, name in enumerate(names):
        avd_writer.write_pixels(folder, name, np.full((48, 64, 3), index, dtype=np.uint8), floor_depth(poses[index]))
        turns = [names.index(links[index][move]) for move in ("rotate_cw", "rotate_ccw")]
        boxes = (Annotation(1 + index % 2, (20, 20, 40, 44), 1), Annotation(1, (0, 0, 9, 9), 4))
        between = poses[turns].mean(axis=0)
        kept = index != UNRECONSTRUCTED
        images.append(SceneImage(name, poses[index], between, index // 12, kept, links[index], boxes))
    avd_writer.write_annotations(folder, images)
    avd_writer.write_image_structs(folder, images, ORIGIN, SCALE_MM)
    avd_writer.write_instances(root, folder, OBJECTS)
    avd_writer.write_camera(folder, CAMERA, len(images))
    return folder, poses


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[tuple[avd.AvdScene, np.ndarray]]:
    folder, poses = write_scene(tmp_path)
    yield avd.read_scene(folder), poses


def test_poses_come_back_metric_with_the_floor_at_zero(scene: tuple[avd.AvdScene, np.ndarray]) -> None:
    read, poses = scene
    shift = np.array([ORIGIN[0], ORIGIN[1], 0.0])  # the world's origin in map; heights come from the depth of the floor
    for index, image in enumerate(read.images.values()):
        if index != UNRECONSTRUCTED:
            np.testing.assert_allclose(image.T_map_camera[:3, :3], poses[index][:3, :3], atol=1e-9)
            np.testing.assert_allclose(image.T_map_camera[:2, 3] + shift[:2], poses[index][:2, 3], atol=1e-9)
            assert image.T_map_camera[2, 3] == pytest.approx(HEIGHT_M, abs=0.005)


def test_rotation_of_an_unreconstructed_image_is_rebuilt_and_said(scene: tuple[avd.AvdScene, np.ndarray]) -> None:
    read, poses = scene
    name = list(read.images)[UNRECONSTRUCTED]
    assert read.rebuilt == (name,)
    assert read.dropped == ()
    rotation = read.images[name].T_map_camera[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    angle = np.arccos((np.trace(rotation.T @ poses[UNRECONSTRUCTED][:3, :3]) - 1.0) / 2.0)
    assert angle < 0.05  # neighbours deviate by 0.015 rad each


def test_records_follow_the_real_conventions(tmp_path: Path) -> None:
    """X_cam = R X_world + t, world_pos = -R^T t, direction = R^T [0, 0, 1]; empty R and t where not reconstructed."""
    folder, _ = write_scene(tmp_path)
    content = loadmat(folder / "image_structs.mat")
    assert content["scale"][0][0] == SCALE_MM
    records = content["image_structs"][0]
    assert records.dtype.names[:6] == ("image_name", "t", "R", "world_pos", "direction", "quat")
    for index, record in enumerate(records):
        assert (record["R"].size == 0) == (record["t"].size == 0) == (index == UNRECONSTRUCTED)
        if index != UNRECONSTRUCTED:
            np.testing.assert_allclose(record["world_pos"], -record["R"].T @ record["t"], atol=1e-12)
            np.testing.assert_allclose(record["direction"], record["R"].T[:, 2:], atol=1e-12)


def rewrite(folder: Path, change: str) -> None:
    """Damage or mirror one record's pose in image_structs.mat."""
    content = loadmat(folder / "image_structs.mat")
    records = content["image_structs"]
    for record in records[0]:
        if change == "y up":  # another structure from motion: y and z of the world point the other way
            mirror = np.diag([1.0, -1.0, -1.0])
            record["R"] = record["R"] @ mirror if record["R"].size else record["R"]
            record["world_pos"], record["direction"] = mirror @ record["world_pos"], mirror @ record["direction"]
    if change == "no pose":
        for field in ("R", "t", "world_pos", "direction"):
            records[0][3][field] = np.zeros((0, 0))
    savemat(folder / "image_structs.mat", {"image_structs": records, "scale": content["scale"]})


def test_world_with_y_up_gives_the_same_map(scene: tuple[avd.AvdScene, np.ndarray]) -> None:
    read, _ = scene
    rewrite(read.folder, "y up")
    for name, image in avd.read_scene(read.folder).images.items():
        np.testing.assert_allclose(image.T_map_camera, read.images[name].T_map_camera, atol=1e-6)


def test_image_without_any_pose_is_dropped_and_said(scene: tuple[avd.AvdScene, np.ndarray]) -> None:
    read, _ = scene
    rewrite(read.folder, "no pose")
    again = avd.read_scene(read.folder)
    lost = list(read.images)[3]
    assert again.dropped == (lost,)
    assert lost not in again.images
    assert all(lost not in image.moves.values() for image in again.images.values())


def test_names_boxes_depth_and_camera(scene: tuple[avd.AvdScene, np.ndarray]) -> None:
    read, poses = scene
    name = "200710000040101.jpg"
    assert read.depth_path(name).name == "200710000040103.png"
    image = read.images[name]
    np.testing.assert_array_equal(image.boxes, [[20, 20, 40, 44], [0, 0, 9, 9]])
    assert image.instance_ids.tolist() == [1, 1]
    assert image.difficulties.tolist() == [1, 4]
    np.testing.assert_allclose(read.depth_m(name), floor_depth(poses[4]), atol=5.1e-4)
    assert read.image(name).mean() == pytest.approx(4.0, abs=0.5)
    assert (read.camera.width, read.camera.height) == (64, 48)
    assert read.camera.fx == pytest.approx(CAMERA.fx)
    assert read.instance_names == {1: "crate_1", 2: "desk_1"}


def test_camera_file_beside_the_scenes_is_found(scene: tuple[avd.AvdScene, np.ndarray]) -> None:
    folder = scene[0].folder
    other = folder.parent / "camera_params" / folder.name
    other.mkdir(parents=True)
    (folder / "cameras.txt").rename(other / "cameras.txt")
    assert avd.read_scene(folder).camera.cx == pytest.approx(CAMERA.cx)
    (other / "cameras.txt").unlink()
    with pytest.raises(InputError, match=r"cameras\.txt: missing"):
        avd.read_scene(folder)


@pytest.mark.parametrize("file", ["annotations.json", "image_structs.mat"])
def test_damaged_file_is_named(scene: tuple[avd.AvdScene, np.ndarray], file: str) -> None:
    folder = scene[0].folder
    (folder / file).write_bytes(b"{" * 300)
    with pytest.raises(InputError, match=file.replace(".", r"\.")):
        avd.read_scene(folder)


def test_a_file_on_which_the_reader_dies_is_damaged(tmp_path: Path) -> None:
    """Two bytes of a struct's fields: with scipy 1.17 a segfault, which a process of its own catches."""
    records = np.zeros((1, 3), dtype=[(name, "O") for name in ("image_name", "R", "world_pos", "direction")])
    for number in range(3):
        records[0, number] = f"{number:06d}.jpg", np.eye(3), np.ones((3, 1)), np.ones((3, 1))
    path = tmp_path / "image_structs.mat"
    savemat(path, {"image_structs": records, "scale": np.array([[1.0]])})
    assert read_matlab(path)["image_structs"][0][1]["world_pos"] == [[1.0], [1.0], [1.0]]
    content = bytearray(path.read_bytes())
    content[305], content[910] = 102, 74
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"image_structs\.mat: not a readable .* restore it from the data set"):
        read_matlab(path)


@pytest.mark.parametrize("order", [b"IM", b"XX"])
def test_a_file_that_unpacks_to_gigabytes_is_refused_before_it_does(
    scene: tuple[avd.AvdScene, np.ndarray], order: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Zeros in four elements, 64 MB each; scipy takes whatever is not little-endian for big-endian."""
    monkeypatch.setattr("semantic_slam.datasets.avd.matlab_file._read_apart", None)
    path = scene[0].folder / "image_structs.mat"
    packed = zlib.compressobj(9)
    element = b"".join([packed.compress(bytes(1 << 20)) for _ in range(64)]) + packed.flush()
    sizes = struct.pack("<II" if order == b"IM" else ">II", 15, len(element))
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1" + order + 4 * (sizes + element))
    with pytest.raises(InputError, match=r"image_structs\.mat: holds more than 200 MB; restore it"):
        avd.read_scene(scene[0].folder)


def test_moves_lead_where_they_say(scene: tuple[avd.AvdScene, np.ndarray]) -> None:
    read, _ = scene
    steps = {"forward": (1.0, 0.0), "backward": (-1.0, 0.0), "left": (0.0, 1.0), "right": (0.0, -1.0)}
    for image in read.images.values():
        here = avd_import.planar_poses(read, [avd_path.Stop(image.name, True)])[0]
        for move, target in image.moves.items():
            there = avd_import.planar_poses(read, [avd_path.Stop(target, True)])[0]
            turn = (there[2] - here[2] + np.pi) % (2.0 * np.pi) - np.pi
            if move.startswith("rotate"):
                assert turn == pytest.approx(np.pi / 6.0 * (1 if move == "rotate_ccw" else -1), abs=0.1)
            else:
                c, s = np.cos(here[2]), np.sin(here[2])
                body = np.array([[c, s], [-s, c]]) @ (there[:2] - here[:2]) / 0.3
                assert body @ steps[move] > 0.75  # within 31 degrees, and the noise of the positions
                assert abs(turn) < 0.1


def test_path_file_of_names_and_moves(scene: tuple[avd.AvdScene, np.ndarray], tmp_path: Path) -> None:
    read, _ = scene
    names = list(read.images)
    file = tmp_path / "path.txt"
    file.write_text(f"{names[0]}  # start\nforward\nrotate_ccw\n\n{names[1]}\n")
    stops = avd_path.read_path(read, file)
    assert [stop.name for stop in stops] == [names[0], names[12], names[13], names[1]]
    file.write_text(f"{names[0]}\n{names[24]}\n")  # two steps ahead: the one between gives odometry only
    assert avd_path.read_path(read, file) == (
        avd_path.Stop(names[0], True),
        avd_path.Stop(names[12], False),
        avd_path.Stop(names[24], True),
    )


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("forward\n", "starts with a move"),
        ("{0}\nbackward\n", "nothing lies"),
        ("{0}\nsideways\n", "neither"),
        ("", "empty"),
    ],
)
def test_bad_path_file(scene: tuple[avd.AvdScene, np.ndarray], tmp_path: Path, text: str, fault: str) -> None:
    file = tmp_path / "path.txt"
    file.write_text(text.format(next(iter(scene[0].images))))
    with pytest.raises(InputError, match=fault):
        avd_path.read_path(scene[0], file)


def test_automatic_tour_is_connected_and_shows_every_object(scene: tuple[avd.AvdScene, np.ndarray]) -> None:
    read, _ = scene
    tour = avd_path.automatic_tour(read, max_difficulty=2)
    assert tour == avd_path.automatic_tour(read, max_difficulty=2)
    for before, after in pairwise(tour):
        assert after.name in read.images[before.name].moves.values()
    shown = [number for stop in tour for number in read.images[stop.name].instance_ids[:1]]
    assert min(shown.count(1), shown.count(2)) >= avd_path.VIEWS_PER_OBJECT


def test_odometry_noise_is_as_stated() -> None:
    """Straight steps of 0.3 m: the end spreads as the covariance says (chi square per degree of freedom about 1)."""
    truth = np.column_stack([np.arange(20) * 0.3, np.zeros(20), np.zeros(20)])
    noise = OdometryNoise()
    np.testing.assert_allclose(step_sigma(np.array([0.3, 0.0, 0.5]), noise), [0.024, 0.024, 0.015 + 0.025])
    runs = [simulate_odometry(truth, noise, np.random.default_rng(seed)) for seed in range(200)]
    errors = np.array([run.poses[-1] - truth[-1] for run in runs])
    squared = [error @ np.linalg.solve(run.covariances[-1], error) for error, run in zip(errors, runs, strict=True)]
    assert np.mean(squared) / 3.0 == pytest.approx(1.0, abs=0.2)  # 3 standard deviations of the mean: 0.17


def test_objects_are_triangulated_where_there_is_no_truth(scene: tuple[avd.AvdScene, np.ndarray]) -> None:
    """Every box shows the floor; its points are those of the floor in the middle of the box."""
    prior = triangulated_prior(scene[0], max_difficulty=2)
    assert [known.object_id for known in prior.objects] == [1, 2]
    for known in prior.objects:
        assert known.pose[2] == pytest.approx(0.0, abs=0.1)  # a row of pixels there is 0.1 m of floor
        assert known.covariance[5, 5] > np.pi**2  # no heading
        assert known.covariance[0, 0] >= POSITION_VARIANCE_M2


def test_scene_becomes_a_bag(scene: tuple[avd.AvdScene, np.ndarray], tmp_path: Path) -> None:
    read, _ = scene
    truth = {"id": 1, "name": "crate_1", "class": "crate", "pose": OBJECTS[0].pose.tolist()}
    second = {"id": 2, "name": "desk_1", "class": "desk", "pose": OBJECTS[1].pose.tolist()}
    world = {"linear": np.eye(3).tolist(), "offset": ORIGIN.tolist()}
    (read.folder / "ground_truth.json").write_text(json.dumps({"map_from_world": world, "objects": [truth, second]}))
    names = list(read.images)
    (read.folder / "tour.txt").write_text(f"{names[0]}\n{names[24]}\n{names[25]}\n")
    settings = avd_import.ImportSettings(image_width=32, min_box_height_px=10.0)
    result = avd_import.import_avd(read.folder, tmp_path / "bag", seed=3, settings=settings)
    assert (result.keyframes, result.odometry_samples, result.detections) == (3, 4, 3)
    assert result.skipped == {"too difficult": 3}
    prior = read_map_prior(tmp_path / "bag" / "objects.json")
    assert [known.class_probabilities for known in prior.objects] == [{}, {}]
    off = planar_from_pose_vector(prior.objects[0].pose) - planar_from_pose_vector(OBJECTS[0].pose)
    assert 0.0 < np.abs(off[:2]).max() < 5.0 * np.sqrt(POSITION_VARIANCE_M2)
    with BagReader(tmp_path / "bag") as reader:
        counts = reader.counts
        detections, initial = (next(reader.messages([topic])) for topic in ("detections", "initialpose"))
        seen = reader.decode(detections.cdr, detections.type_name)
        start = reader.decode(initial.cdr, initial.type_name)
    assert counts["/odom"] == counts["/ground_truth/odom"] == 4
    assert counts["/detections"] == counts["/image/compressed"] == counts["/depth/compressed"] == 3
    np.testing.assert_allclose(seen.boxes, [10.0, 10.0, 20.0, 22.0])  # half the width, half the box
    assert (seen.labels, seen.track_ids) == (["object"], [""])
    np.testing.assert_allclose(np.diag(start.pose.covariance.reshape(6, 6))[[0, 1, 5]], [100.0, 100.0, 0.04])
    assert counts["/tf_static"] == counts["/initialpose"] == counts["/ground_truth/objects"] == 1


def test_same_seed_same_bag_other_seed_other_odometry(scene: tuple[avd.AvdScene, np.ndarray], tmp_path: Path) -> None:
    read, _ = scene
    settings = avd_import.ImportSettings(min_box_height_px=10.0)
    files = []
    for folder, seed in (("a", 1), ("b", 1), ("c", 2)):
        bag = tmp_path / folder / "bag"
        avd_import.import_avd(read.folder, bag, seed=seed, max_keyframes=4, settings=settings)
        files.append((bag / "bag.mcap").read_bytes())
    assert files[0] == files[1] != files[2]


def test_two_scenes_in_a_root_ask_for_one(tmp_path: Path) -> None:
    for name in ("Home_001_1", "Home_002_1"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "annotations.json").write_text("{}")
    with pytest.raises(InputError, match="Home_001_1, Home_002_1"):
        avd.find_scene(tmp_path)


def test_missing_picture_is_named(scene: tuple[avd.AvdScene, np.ndarray]) -> None:
    read, _ = scene
    name = next(iter(read.images))
    (read.colour_path / name).unlink()
    with pytest.raises(InputError, match=name):
        read.image(name)
    assert cv2.imread(str(read.depth_path(name)), cv2.IMREAD_UNCHANGED).dtype == np.uint16
