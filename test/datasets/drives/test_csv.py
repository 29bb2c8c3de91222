"""Tables of one's own: columns by name, frames by stamp, truth where it is given."""

import codecs
import gzip

import numpy as np
import pytest
from worlds.bags.imported import import_bag

from semantic_slam.errors import InputError
from semantic_slam.geometry.pose import planar_from_pose_vector

ODOMETRY = "stamp_ns,x,y,yaw\n1000,0,0,0\n2000,1,0,0.5\n"
DETECTIONS = (
    "bearing_rad,range_m,stamp_ns,label,track_id\n0.1,2.0,1000,cup,a\n-0.2,3.0,1000,,\n,,1500,,\n0.3,4.0,2000,cup,a\n"
)
TRUTH = f"stamp_ns,x,y,yaw\n1000,5,5,{np.pi / 2}\n2000,5,6,{np.pi / 2}\n"
OBJECTS = "object_id,x,y,class\n7,5,8,cup\n"


@pytest.fixture
def folder(tmp_path):
    source = tmp_path / "source"
    source.mkdir()
    (source / "odometry.csv").write_text(ODOMETRY)
    (source / "detections.csv").write_text(DETECTIONS)
    return source


def run(monkeypatch, folder):
    return import_bag(monkeypatch, "csv", folder, "--out", folder.parent / "bag")


def test_detections_of_one_stamp_are_a_frame_and_an_empty_row_an_empty_frame(folder, monkeypatch):
    bag = run(monkeypatch, folder)
    assert bag.keys() == {"/odom", "/detections"}
    frames = bag["/detections"]
    assert [frame.stamp_ns for frame in frames] == [1000, 1500, 2000]
    assert [frame.labels for frame in frames] == [("cup", ""), (), ("cup",)]
    assert [frame.track_ids for frame in frames] == [("a", ""), (), ("a",)]
    np.testing.assert_array_equal(frames[0].ranges_m, [2.0, 3.0])
    np.testing.assert_array_equal(frames[0].bearings_rad, [0.1, -0.2])
    np.testing.assert_array_equal(frames[0].scores, [1.0, 1.0])


@pytest.mark.parametrize("suffix", ["", ".gz"])
def test_the_byte_order_mark_of_a_spreadsheet_is_no_part_of_the_table(folder, monkeypatch, suffix):
    for name in ("odometry.csv", "detections.csv"):
        text = (folder / name).read_bytes()
        (folder / name).unlink()
        marked = codecs.BOM_UTF8 + text
        (folder / f"{name}{suffix}").write_bytes(gzip.compress(marked) if suffix else marked)
    assert [frame.stamp_ns for frame in run(monkeypatch, folder)["/detections"]] == [1000, 1500, 2000]


def test_truth_is_moved_to_the_start(folder, monkeypatch):
    (folder / "ground_truth.csv").write_text(TRUTH)
    (folder / "objects.csv").write_text(OBJECTS)
    (folder / "detections.csv").write_text("stamp_ns,range_m,bearing_rad,object_id,score\n1000,2.0,0.1,7,0.25\n")
    bag = run(monkeypatch, folder)
    poses = planar_from_pose_vector(np.array([pose.pose for pose in bag["/ground_truth/odom"]]))
    np.testing.assert_allclose(poses, [[0, 0, 0], [1, 0, 0]], atol=1e-12)
    objects = bag["/ground_truth/objects"][0]
    assert (objects.object_ids, objects.class_names) == (("7",), ("cup",))
    np.testing.assert_allclose(objects.poses[0, :2], [3, 0], atol=1e-12)
    assert bag["/ground_truth/associations"][0].object_ids == ("7",)
    assert bag["/detections"][0].scores.tolist() == [0.25]


@pytest.mark.parametrize(
    ("name", "text", "fault"),
    [
        ("odometry.csv", "stamp_ns,x,y\n1,0,0\n", "line 1: no column yaw"),
        ("odometry.csv", "stamp_ns,x,y,yaw\n", "no lines after the header"),
        ("odometry.csv", "stamp_ns,x,y,yaw\n2,0,0,0\n1,0,0,0\n", "line 3: time goes backwards, from 2 to 1"),
        ("odometry.csv", "stamp_ns,x,y,yaw\n2,0,0,0\n2,0,0,0\n", "line 3: stamp 2 again"),
        ("odometry.csv", "stamp_ns,x,y,yaw\n1.5,0,0,0\n", "line 2: stamp_ns is '1.5', not a whole number"),
        ("odometry.csv", "stamp_ns,x,y,yaw\n1,0,nan,0\n", "line 2: y is 'nan', not a finite number"),
        ("odometry.csv", "stamp_ns,x,y,yaw\n1,0,0\n", "line 2: 3 columns, but the first line names 4"),
        ("detections.csv", "stamp_ns,range_m,bearing_rad,size\n1,2,0,3\n", "line 1: unknown column 'size'"),
        ("detections.csv", "stamp_ns,range_m,bearing_rad\n1,2,\n", "line 2: bearing_rad is '', not a finite number"),
        ("objects.csv", OBJECTS, "objects.csv: in the frame of true poses, which are not there"),
    ],
)
def test_a_bad_table_is_named_with_its_line(folder, monkeypatch, name, text, fault):
    (folder / name).write_text(text)
    with pytest.raises(InputError, match=fault):
        run(monkeypatch, folder)
