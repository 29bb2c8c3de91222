"""Folders of the TUM RGB-D benchmark's kind become bags of a camera in all six."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from worlds.bags.image_folder import hand_held
from worlds.bags.imported import messages_of, read_bag
from worlds.bags.tum_folder import stamp_s, write_tum_folder
from worlds.views.onnx_networks import COLOURS, write_network

from semantic_slam.bag.reader import BagReader
from semantic_slam.cli import import_dataset
from semantic_slam.configuration import from_dict, load_configuration, to_dict
from semantic_slam.datasets.space.levelling import level_start, map_of_start
from semantic_slam.datasets.space.noisy_odometry import noisy_odometry_in_space
from semantic_slam.datasets.space.path import SpatialPath
from semantic_slam.errors import InputError
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.geometry import se3, so3
from semantic_slam.messages import topics
from semantic_slam.messages.inertial import imu_reading
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.shipped import CONFIGURATIONS

PLANAR = np.array([[0.1 * k, 0.05 * k, 0.1 * k - 0.2] for k in range(7)])
PITCHES, ROLLS = [0.35, 0.45, 0.3, 0.5, 0.4, 0.35, 0.3], [0.1, -0.1, 0.05, 0.0, -0.05, 0.1, 0.0]
HEIGHTS = [1.4, 1.45, 1.5, 1.45, 1.4, 1.35, 1.4]
POINTS = np.array([[2.0, 0.3, 0.4], [2.2, -0.5, 0.8]])


def poses():
    return [
        hand_held(planar, pitch, roll, height, np.eye(3))
        for planar, pitch, roll, height in zip(PLANAR, PITCHES, ROLLS, HEIGHTS, strict=True)
    ]


def imported(source, tmp_path, *words):
    bag = tmp_path / "bag"
    module, arguments = import_dataset.parse(["tum_rgbd", str(source), "--out", str(bag), *words])
    module.run(arguments, bag)
    return bag


def in_map():
    """The points seen from the first body, whose heading alone is undone."""
    c, s = np.cos(PLANAR[0, 2]), np.sin(PLANAR[0, 2])
    away = POINTS - [PLANAR[0, 0], PLANAR[0, 1], HEIGHTS[0]]
    return away @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@pytest.fixture
def folder(tmp_path):
    write_tum_folder(tmp_path / "source", poses(), POINTS)
    return tmp_path / "source"


def test_map_begins_at_the_first_pose_with_gravity_down(folder, tmp_path):
    bag = imported(folder, tmp_path, "--drift", "0")
    (start,) = messages_of(bag, topics.INITIAL_POSE)
    true = messages_of(bag, topics.GROUND_TRUTH_ODOMETRY)
    np.testing.assert_allclose(true[0].pose, start.pose, atol=1e-8)
    np.testing.assert_allclose(start.pose[:3], 0.0, atol=1e-9)
    forward = so3.rotated(start.pose[3:], np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(forward, [np.cos(PITCHES[0]), 0.0, -np.sin(PITCHES[0])], atol=1e-6)
    np.testing.assert_allclose(messages_of(bag, topics.GROUND_TRUTH_OBJECTS)[0].poses[:, :3], in_map(), atol=1e-6)


def test_odometry_without_noise_is_the_truth_from_its_start(folder, tmp_path):
    bag = imported(folder, tmp_path, "--drift", "0")
    told, true = messages_of(bag, topics.ODOMETRY), messages_of(bag, topics.GROUND_TRUTH_ODOMETRY)
    for first, second in zip(told, true, strict=True):
        step = se3.between(true[0].pose, second.pose)
        np.testing.assert_allclose(se3.log(se3.between(first.pose, step)), 0.0, atol=1e-7)
    np.testing.assert_array_equal(told[-1].covariance, 0.0)


def test_what_depth_shows_stands_where_it_stands(folder, tmp_path):
    bag = imported(folder, tmp_path, "--drift", "0")
    true = {row.stamp_ns: row.pose for row in messages_of(bag, topics.GROUND_TRUTH_ODOMETRY)}
    frames = messages_of(bag, topics.DETECTIONS)
    assert [len(frame) for frame in frames][-1] == 0
    assert len(frames) == len(PLANAR)
    for frame, seen in zip(frames, messages_of(bag, topics.GROUND_TRUTH_ASSOCIATIONS), strict=True):
        pose = true[frame.stamp_ns]
        for position, name in zip(frame.positions, seen.object_ids, strict=True):
            there = pose[:3] + so3.rotated(pose[3:], position)
            assert np.linalg.norm(there - in_map()[int(name)]) < 0.02  # a pixel at two metres, rounded


def test_boxes_alone_are_enough(tmp_path):
    write_tum_folder(tmp_path / "source", poses(), POINTS, with_pictures=False)
    (tmp_path / "source" / "rgb.txt").unlink()
    (tmp_path / "source" / "depth.txt").unlink()
    bag = imported(tmp_path / "source", tmp_path)
    with BagReader(bag) as reader:
        assert "/image/compressed" not in reader.topics
        assert {"/camera_info", "/tf_static", "/initialpose"} <= set(reader.topics)
    frames = messages_of(bag, topics.DETECTIONS)
    assert len(frames) == len(PLANAR) - 1  # nobody tells of pictures that show nothing
    assert np.isnan(frames[0].positions).all()
    assert np.isfinite(frames[0].boxes).all()


def test_the_covariance_that_odometry_states_is_that_of_its_errors():
    stamps = np.arange(12) * 10**9
    steps = se3.exp(np.tile([0.05, -0.1, 0.2, 0.3, 0.05, -0.1], (11, 1)))
    start = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    path = SpatialPath(stamps, np.concatenate([start[None], se3.along(start, steps)]))
    errors = []
    for seed in range(400):
        told = noisy_odometry_in_space(path, 0.03, np.random.default_rng(seed))
        error = se3.log(se3.between(told.poses[-1], path.poses[-1]))
        spread = se3.covariance_at_pose(told.poses[-1], told.covariances[-1])
        errors.append(error @ np.linalg.solve(spread, error))
    assert np.mean(errors) == pytest.approx(6.0, abs=4.0 * np.sqrt(12.0 / 400))


def test_a_level_start_sees_up_where_it_is_and_keeps_its_heading():
    for up in np.random.default_rng(0).normal(size=(20, 3)):
        up /= np.linalg.norm(up)
        np.testing.assert_allclose(so3.rotated(level_start(up)[3:], up), [0.0, 0.0, 1.0], atol=1e-12)
    start = np.append([3.0, -1.0, 2.0], so3.exp(np.array([0.4, -0.3, 1.0])))
    moved = se3.compose(map_of_start(start, np.array([0.0, 0.0, 1.0])), start)
    forward = so3.rotated(moved[3:], np.array([1.0, 0.0, 0.0]))
    assert forward[1] == pytest.approx(0.0, abs=1e-12)
    assert forward[0] > 0.0


def test_the_pipeline_maps_them_in_space(folder, tmp_path):
    bag = imported(folder, tmp_path, "--drift", "0.01")
    values = to_dict(load_configuration(CONFIGURATIONS / "spatial.yaml"))
    summary = run_bag(bag, tmp_path / "beliefs", from_dict(values, "test"))
    assert summary.num_keyframes >= 3
    last = read_record(tmp_path / "beliefs").beliefs[-1]
    there = last.object_poses[last.existence > 0.5][:, :3]
    assert np.linalg.norm(there[:, None] - in_map(), axis=2).min(axis=0).max() < 0.05


def test_an_inertial_sensor_levels_the_map_where_the_world_of_the_poses_leans(tmp_path):
    """The world of the poses is tilted; accelerations along the optical axes tell by how much."""
    tilt = Rotation.from_euler("xyz", [0.1, -0.15, 0.0]).as_matrix()
    leaning = []
    for pose in poses():
        moved = pose.copy()
        moved[:3] = tilt @ pose[:3]
        leaning.append(moved)
    folder = tmp_path / "source"
    write_tum_folder(folder, leaning, [tilt @ point for point in POINTS], with_pictures=False)
    rows = [
        " ".join(f"{value:.6f}" for value in [stamp_s(n), *(9.81 * pose[:3, :3].T @ tilt[:, 2]), 0.0, 0.0, 0.0])
        for n, pose in enumerate(leaning)
    ]
    (folder / "imu.txt").write_text("\n".join(rows) + "\n")
    bag = imported(folder, tmp_path, "--drift", "0")
    np.testing.assert_allclose(messages_of(bag, topics.GROUND_TRUTH_OBJECTS)[0].poses[:, :3], in_map(), atol=1e-5)
    shown, (start,) = read_bag(bag)["/imu"], messages_of(bag, topics.INITIAL_POSE)
    assert len(shown) == len(rows) and start.covariance[3, 3] == start.covariance[4, 4] == 0.02**2
    assert imu_reading(shown[0]).acceleration.tolist() == [float(word) for word in rows[0].split()[1:4]]
    (folder / "imu.txt").write_text("\n".join(row.replace("-", "") for row in rows) + "\n")
    with pytest.raises(InputError, match="along the axes of the optical frame"):
        imported(folder, tmp_path, "--drift", "0")


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("groundtruth.txt", "1 0 0 0 0 0 0 1\n2 0 0 0 0 0", "6 columns"),
        ("groundtruth.txt", "1 0 0 nan 0 0 0 1\n", "z is 'nan'"),
        ("groundtruth.txt", "2 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n", "time goes backwards"),
        ("detections.csv", "stamp_s,label,score,x_min,y_min,x_max,y_max\n1,cup,0.9,1,1,nan,2\n", "x_max is 'nan'"),
        ("detections.csv", "stamp_s,label,score,x_min,y_min,x_max,y_max\n1,cup,0.9,5,1,2,2\n", "without an inside"),
        ("detections.csv", "2,cup,0.9,1,1,2,2\n1,cup,0.9,1,1,2,2\n", "time goes backwards"),
        ("detections.csv", "stamp_s,label\n", "no column score"),
        ("camera.txt", "0 140 80 60 160 120\n", "not above zero"),
        ("camera.txt", "140 140 80 60 0 120\n", "a picture of 0 x 120"),
        ("imu.txt", "1000.0 0 9.8\n", "3 columns"),
        ("imu.txt", "1 0 9.8 0 0 0 0\n", "no reading while"),
        ("rgb.txt", "1000.0\n", "expected time file"),
    ],
)
def test_a_fault_is_named_with_its_file(folder, tmp_path, name, text, said):
    (folder / name).write_text(text)
    with pytest.raises(InputError, match=said):
        imported(folder, tmp_path)


def test_what_is_missing_is_said_in_a_line(folder, tmp_path):
    with pytest.raises(InputError, match="go together"):
        imported(folder, tmp_path, "--detector", "x.onnx")
    (folder / "groundtruth.txt").unlink()
    with pytest.raises(InputError, match=r"neither groundtruth.txt nor odometry.txt"):
        imported(folder, tmp_path)


def test_a_detectors_open_input_has_the_size_that_the_command_gives(folder, tmp_path):
    """Patches are red; an input of the pictures' width leaves them at their size, in cells of 8 pixels."""
    network = write_network(tmp_path / "net.onnx", "yolov5", open_sizes=(2, 3))
    (tmp_path / "net.names").write_text("\n".join(COLOURS))
    words = ("--detector", str(network), "--labels-of", str(tmp_path / "net.names"))
    with pytest.raises(InputError, match=r"leaves its input size open.*--input-size"):
        imported(folder, tmp_path, *words)
    frames = messages_of(imported(folder, tmp_path, *words, "--input-size", "160"), topics.DETECTIONS)
    true = messages_of(imported(folder, tmp_path / "own"), topics.DETECTIONS)
    for found, own in zip(frames[:-1], true[:-1], strict=True):
        assert found.labels and set(found.labels) == {"red"}
        centres = (found.boxes[:, :2] + found.boxes[:, 2:]) / 2
        inside = (centres[:, None] > own.boxes[:, :2]) & (centres[:, None] < own.boxes[:, 2:])
        assert inside.all(axis=2).any(axis=0).all()


def test_what_describes_a_detector_needs_one(folder, tmp_path):
    for words in (("--input-size", "640"), ("--layout", "yolov5")):
        with pytest.raises(InputError, match="are a detector's"):
            imported(folder, tmp_path, *words)
