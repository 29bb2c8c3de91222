"""Landmark graphs: odometry is the chain of poses, sightings keep their covariances, numbers are truth alone."""

import gzip

import numpy as np
import pytest
from worlds.bags.imported import import_bag

from semantic_slam.datasets.drives.g2o import read_graph
from semantic_slam.datasets.drives.g2o_import import drive_of
from semantic_slam.errors import InputError
from semantic_slam.geometry.pose import planar_from_pose_vector

GRAPH = f"""VERTEX_SE2 0 9 9 9
VERTEX_XY 1 3 4
VERTEX_SE2 5 0 0 0
EDGE_SE2_XY 0 1 3.0 4.0 4.0 0.0 25.0
EDGE_SE2 0 5 1.0 0.0 {np.pi / 2} 1 0 0 1 0 1
VERTEX_SE2 7 0 0 0
EDGE_SE2 5 7 2.0 0.0 0.0 1 0 0 1 0 1
EDGE_SE2 0 7 9.0 9.0 0.0 1 0 0 1 0 1
EDGE_SE2_XY 7 2 1.0 0.0 2.0 1.0 2.0
FIX 0
"""


@pytest.fixture
def graph(tmp_path):
    path = tmp_path / "graph.g2o"
    path.write_text(GRAPH)
    return path


def test_odometry_is_the_chain_of_poses(graph, monkeypatch, tmp_path, capsys):
    bag = import_bag(monkeypatch, "g2o", graph, "--period", 0.5, "--out", tmp_path / "bag")
    poses = planar_from_pose_vector(np.array([pose.pose for pose in bag["/odom"]]))
    np.testing.assert_allclose(poses, [[0, 0, 0], [1, 0, np.pi / 2], [1, 2, np.pi / 2]], atol=1e-12)
    assert np.diff([pose.stamp_ns for pose in bag["/odom"]]).tolist() == [500_000_000] * 2
    text = capsys.readouterr().out
    assert "stamps are made up: the file has none; 0.5 s from pose to pose, 1.0 s" in text
    assert "left out: 1 EDGE_SE2 between poses that do not follow each other" in text
    assert "left out: 1 FIX" in text


def test_every_pose_is_a_frame_with_the_covariances_of_the_file(graph, monkeypatch, tmp_path):
    bag = import_bag(monkeypatch, "g2o", graph, "--out", tmp_path / "bag")
    frames = bag["/detections"]
    assert [len(frame) for frame in frames] == [1, 0, 1]
    np.testing.assert_allclose(frames[0].positions, [[3.0, 4.0, 0.0]])
    np.testing.assert_allclose(frames[0].position_covariances[0], np.diag([0.25, 0.04, 0.0]))
    np.testing.assert_allclose(frames[2].position_covariances[0, :2, :2], [[2 / 3, -1 / 3], [-1 / 3, 2 / 3]])


def test_landmark_numbers_are_ground_truth_only(graph, monkeypatch, tmp_path):
    bag = import_bag(monkeypatch, "g2o", graph, "--out", tmp_path / "bag")
    assert [frame.track_ids for frame in bag["/detections"]] == [("",), (), ("",)]
    assert [truth.object_ids for truth in bag["/ground_truth/associations"]] == [("1",), (), ("2",)]
    assert bag.keys() == {"/odom", "/detections", "/ground_truth/associations"}


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("3.0 4.0 4.0", "3.0 nan 4.0", "line 4: dy is 'nan', not a finite number"),
        ("4.0 0.0 25.0", "4.0 0.0", "line 4: 6 columns, expected pose landmark dx dy I11 I12 I22"),
        ("4.0 0.0 25.0", "4.0 90.0 25.0", "line 4: information that is not positive definite"),
        ("EDGE_SE2_XY 7", "EDGE_SE2_XY 8", "line 9: a landmark is seen from pose 8"),
        ("EDGE_SE2 5 7", "EDGE_SE2 7 5", "no EDGE_SE2 from pose 5 to the next, 7"),
        ("EDGE_SE2_XY", "EDGE_SE2_YX", "3 poses and 0 sightings of landmarks, besides EDGE_SE2_YX, FIX"),
    ],
)
def test_a_bad_graph_is_named_with_its_line(graph, old, new, fault):
    graph.write_text(GRAPH.replace(old, new))
    with pytest.raises(InputError, match=fault):
        read_graph(graph)


def test_a_file_of_another_kind_is_refused_with_its_first_words_alone(tmp_path):
    path = tmp_path / "measurements.csv"
    path.write_text("".join(f"{row},1.0\n" for row in range(10, 5000)) + f"{'9' * 1000},1.0\n")
    with pytest.raises(InputError, match=r"besides 10,1\.0, .* and 4983 others; name a g2o file") as told:
        read_graph(path)
    assert len(str(told.value)) < len(str(path)) + 400


def test_a_truncated_archive_is_named(tmp_path):
    path = tmp_path / "graph.g2o.gz"
    path.write_bytes(gzip.compress(GRAPH.encode())[:-20])
    with pytest.raises(InputError, match="cannot be read to its end"):
        read_graph(path)


@pytest.mark.real_data
def test_the_dlr_drive_has_its_known_numbers(data_set):
    graph = read_graph(data_set("dlr") / "dlr.g2o.gz")
    drive = drive_of(graph, 0.2224)
    assert len(drive.frames) == len(drive.odometry.poses) == 3297
    assert sum(map(len, drive.frames)) == 14309
    assert len({name for names in drive.associations for name in names}) == 576
    assert (drive.odometry.stamps_ns[-1] - drive.odometry.stamps_ns[0]) / 1e9 == pytest.approx(733.0, abs=0.1)
    assert np.hypot(*graph.increments[:, :2].T).sum() == pytest.approx(505.0, abs=1.0)
    assert not graph.left_out
