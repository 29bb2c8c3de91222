"""MRCLAM: velocities become poses, readings of one picture a frame, barcodes track ids and ground truth."""

import gzip

import numpy as np
import pytest
from worlds.bags.imported import import_bag

from semantic_slam.errors import InputError
from semantic_slam.geometry.pose import planar_from_pose_vector

HEADER = "# made by hand\n# Time [s]   Subject #\n"
FILES = {
    "Barcodes.dat": "1 5\n2 14\n6 63\n7 81\n",
    "Landmark_Groundtruth.dat": "6 2.0 3.0 0.0001 0.0001\n7 1.0 5.0 0.0001 0.0001\n",
    # A quarter turn to the left on a circle of 1 m in two seconds, then a metre straight on.
    "Robot1_Odometry.dat": f"100.0 {np.pi / 4} {np.pi / 4}\n102.0 9 9\n102.0 1.0 0.0\n103.0 0.0 0.0\n",
    "Robot1_Measurement.dat": "100.5 63 2.0 0.5\n100.501 14 3.0 -0.5\n101.0 14 2.0 0.0\n102.5 81 1.0 0.1\n"
    "102.5 43 4.0 0.2\n",
    "Robot1_Groundtruth.dat": f"99.0 7 7 0\n99.9 1.0 1.0 {np.pi / 2}\n101.0 1.0 2.0 {np.pi / 2}\n103.0 1.0 3.0 0.0\n",
    "Robot2_Groundtruth.dat": "99.0 1.0 4.0 0.0\n103.0 9.0 9.0 0.0\n",
}


@pytest.fixture
def folder(tmp_path):
    source = tmp_path / "source"
    source.mkdir()
    for name, text in FILES.items():
        (source / name).write_text(HEADER + text)
    return source


def run(monkeypatch, folder, *words):
    return import_bag(monkeypatch, "mrclam", folder, "--robot", 1, *words, "--out", folder.parent / "bag")


def test_velocities_are_driven_as_exact_arcs(folder, monkeypatch):
    odometry = run(monkeypatch, folder)["/odom"]
    assert [pose.stamp_ns for pose in odometry] == [100 * 10**9, 102 * 10**9, 103 * 10**9]
    poses = planar_from_pose_vector(np.array([pose.pose for pose in odometry]))
    np.testing.assert_allclose(poses, [[0, 0, 0], [1, 1, np.pi / 2], [1, 2, np.pi / 2]], atol=1e-12)


def test_readings_of_one_picture_are_a_frame_and_one_of_robots_alone_stays_empty(folder, monkeypatch):
    bag = run(monkeypatch, folder)
    frames = bag["/detections"]
    assert [frame.track_ids for frame in frames] == [("63",), (), ("81", "43")]
    assert [frame.labels for frame in frames] == [("landmark",), (), ("landmark", "landmark")]
    assert [truth.object_ids for truth in bag["/ground_truth/associations"]] == [("63",), (), ("81", "")]
    np.testing.assert_array_equal(frames[2].ranges_m, [1.0, 4.0])
    np.testing.assert_array_equal(frames[2].bearings_rad, [0.1, 0.2])
    assert np.isnan(frames[2].place_covariances).all()
    assert "/image/compressed" not in bag


def test_what_was_left_out_is_said(folder, monkeypatch, capsys):
    run(monkeypatch, folder)
    text = capsys.readouterr().out
    assert "2 readings of landmarks, 2 of other robots (left out), 1 of barcodes that nobody carries (kept)" in text


def test_truth_is_in_the_frame_of_the_first_true_pose_of_the_drive(folder, monkeypatch):
    bag = run(monkeypatch, folder)
    poses = planar_from_pose_vector(np.array([pose.pose for pose in bag["/ground_truth/odom"]]))
    np.testing.assert_allclose(poses, [[0, 0, 0], [1, 0, 0], [2, 0, -np.pi / 2]], atol=1e-12)
    objects = bag["/ground_truth/objects"][0]
    assert objects.object_ids == ("63", "81")
    np.testing.assert_allclose(objects.poses[:, :2], [[2, -1], [4, 0]], atol=1e-12)


def test_a_drive_that_begins_later_has_its_truth_in_the_frame_of_the_pose_then(folder, monkeypatch):
    bag = run(monkeypatch, folder, "--from-s", 2.2)
    assert [pose.stamp_ns for pose in bag["/odom"]] == [102 * 10**9, 103 * 10**9]
    assert [frame.track_ids for frame in bag["/detections"]] == [("81", "43")]
    assert [truth.object_ids for truth in bag["/ground_truth/associations"]] == [("81", "")]
    poses = planar_from_pose_vector(np.array([pose.pose for pose in bag["/ground_truth/odom"]]))
    np.testing.assert_allclose(poses, [[0, 0, 0], [1, 0, -np.pi / 2]], atol=1e-12)
    np.testing.assert_allclose(bag["/ground_truth/objects"][0].poses[:, :2], [[1, -1], [3, 0]], atol=1e-12)


def test_a_drive_cannot_begin_after_its_last_reading(folder, monkeypatch):
    with pytest.raises(InputError, match=r"nothing is read after --from-s 5\.0; give an earlier time"):
        run(monkeypatch, folder, "--from-s", 5.0)


def test_other_robots_are_kept_with_their_truth_where_that_is_asked_for(folder, monkeypatch):
    bag = run(monkeypatch, folder, "--robots")
    assert [frame.track_ids for frame in bag["/detections"]] == [("63", "14"), ("14",), ("81", "43")]
    labels = [frame.labels for frame in bag["/detections"]]
    assert labels == [("landmark", "robot"), ("robot",), ("landmark", "landmark")]  # nobody carries 43
    named = [truth.object_ids for truth in bag["/ground_truth/associations"]]
    assert named == [("63", "moving/14"), ("moving/14",), ("81", "")]
    objects = bag["/ground_truth/objects"][0]
    assert objects.object_ids == ("63", "81", "moving/14")
    assert objects.moves.tolist() == [False, False, True]
    np.testing.assert_allclose(objects.poses[2, :2], [3, 0], atol=1e-12)


def test_compressed_files_are_read_as_well(folder, monkeypatch):
    plain = run(monkeypatch, folder)
    for path in folder.iterdir():
        (folder / f"{path.name}.gz").write_bytes(gzip.compress(path.read_bytes()))
        path.unlink()
    packed = run(monkeypatch, folder, "--overwrite")
    assert packed.keys() == plain.keys()
    assert [frame.track_ids for frame in packed["/detections"]] == [frame.track_ids for frame in plain["/detections"]]


@pytest.mark.parametrize(
    ("name", "text", "fault"),
    [
        ("Robot1_Measurement.dat", "100.5 63 2.0\n", r"line 3: 3 columns, expected time barcode range bearing"),
        ("Robot1_Measurement.dat", "100.5 63 nan 0.1\n", r"line 3: range is 'nan', not a finite number"),
        ("Robot1_Odometry.dat", "100.0 1 0\n99.0 1 0\n", r"line 4: time goes backwards"),
        ("Robot1_Odometry.dat", "", r"no numbers in it"),
        ("Barcodes.dat", "1 5\n6 5\n", r"barcode 5 is of subjects 1 and 6"),
        ("Barcodes.dat", "1 5\n6 63\n", r"subject 7 has no barcode"),
    ],
)
def test_a_bad_file_is_named_with_its_line(folder, monkeypatch, name, text, fault):
    (folder / name).write_text(HEADER + text)
    with pytest.raises(InputError, match=fault):
        run(monkeypatch, folder)


def test_a_missing_file_is_named(folder, monkeypatch):
    (folder / "Barcodes.dat").unlink()
    with pytest.raises(InputError, match=r"Barcodes\.dat: not there, nor with \.gz"):
        run(monkeypatch, folder)


def test_a_truncated_archive_is_named(folder, monkeypatch):
    path = folder / "Robot1_Measurement.dat"
    rows = "".join(f"{100 + row / 1000:.3f} 63 {row % 7}.{row * 7919 % 1000:03d} 0.1\n" for row in range(2000))
    (folder / "Robot1_Measurement.dat.gz").write_bytes(gzip.compress(rows.encode())[:-2000])
    path.unlink()
    with pytest.raises(InputError, match=r"Robot1_Measurement\.dat\.gz: cannot be read to its end"):
        run(monkeypatch, folder)


@pytest.mark.slow
@pytest.mark.real_data
@pytest.mark.parametrize(
    ("robot", "in_list", "of_robots", "frames", "of_nobody"),
    [
        (1, 1941, 407, 1167, 1),
        (2, 4031, 792, 2195, 0),
        (3, 5625, 1277, 2421, 2),
        (4, 2396, 373, 1341, 3),
        (5, 5378, 1139, 2523, 0),
    ],
)
def test_sightings_of_the_sixth_data_set_are_those_that_are_known(
    data_set, robot, in_list, of_robots, frames, of_nobody
):
    from semantic_slam.datasets.drives.mrclam_import import read_drive

    drive, counts = read_drive(data_set("mrclam_d6"), robot, with_robots=False)
    assert list(counts.values()) == [in_list - of_robots, of_robots, of_nobody]
    assert len(drive.frames) == frames
    assert sum(map(len, drive.frames)) == in_list - of_robots + of_nobody
    assert all(len(set(frame.track_ids)) == len(frame) for frame in drive.frames)  # no picture shows one barcode twice
