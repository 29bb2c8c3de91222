"""Boxes in space in a user's own bag: positions are moved to the body, whatever frame states them."""

import numpy as np
import pytest
from worlds.bags.imported import import_bag, read_bag, run_import
from worlds.bags.user_bag_factory import SECOND, UserBag, write_drive

from semantic_slam.bag.reader import BagReader
from semantic_slam.errors import InputError


def write_boxes_over_a_footprint(path, frame):
    """Boxes in ``frame``; odometry of base_footprint, to which the lidar 1 m above it is fixed."""
    with UserBag(path, "vision_3d") as bag:
        odometry = bag.odometry(SECOND, 0.0)
        odometry.child_frame_id = "base_footprint"
        bag.write("/odom", odometry, SECOND)
        bag.write("/tf_static", bag.transform(SECOND, "base_footprint", "lidar", (0, 0, 1)), SECOND)
        bag.write("/lidar/boxes", bag.vision_3d(SECOND, [("car", (1.0, 2.0, 3.0))], 0.1, frame), SECOND)


@pytest.mark.parametrize(("sigma_m", "frame"), [(0.2, "camera_optical_frame"), (0.0, "base_link")])
def test_boxes_in_space_need_neither_picture_nor_camera(tmp_path, monkeypatch, capsys, sigma_m, frame):
    with UserBag(tmp_path / "source", "vision_3d") as bag:
        bag.write("/tf_static", bag.camera_mount(), SECOND)
        bag.write("/odom", bag.odometry(SECOND, 0.0), SECOND)
        bag.write("/lidar/boxes", bag.vision_3d(SECOND, [("car", (1.0, 2.0, 3.0))], sigma_m, frame), SECOND)
    (found,) = import_bag(monkeypatch, "bag", tmp_path / "source", "--out", tmp_path / "bag")["/detections"]
    # The camera is 0.1 m ahead and 0.3 m up; its z is the body's x, its x the body's -y, its y the body's -z.
    in_camera = frame == "camera_optical_frame"
    np.testing.assert_allclose(found.positions, [[3.1, -1.0, -1.7]] if in_camera else [[1.0, 2.0, 3.0]])
    expected = 0.04 * np.eye(3) if sigma_m else np.full((3, 3), np.nan)
    np.testing.assert_allclose(found.position_covariances[0], expected, atol=1e-12)
    assert (found.labels, found.track_ids, found.frame_id) == (("car",), ("t",), "base_link")
    assert "no image: places alone" in capsys.readouterr().out


def test_boxes_in_a_frame_that_nothing_connects_are_counted(tmp_path, monkeypatch, capsys):
    with UserBag(tmp_path / "source", "vision_3d") as bag:
        bag.write("/odom", bag.odometry(SECOND, 0.0), SECOND)
        bag.write("/lidar/boxes", bag.vision_3d(SECOND, [("car", (1.0, 2.0, 3.0))], 0.1, "lidar"), SECOND)
    with pytest.raises(InputError, match="nothing on /lidar/boxes"):
        run_import(monkeypatch, "bag", tmp_path / "source", "--out", tmp_path / "bag")
    assert "no static transforms lead from base_link to lidar" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("frame", "remedy"),
    [
        ("", "set header.frame_id to the sensor's frame 1"),
        ("odom", "'odom', a frame of the world, are not read: publish them in the sensor's frame 1"),
        ("map", "'map', a frame of the world, are not read: publish them in the sensor's frame 1"),
        ("lidar", "lead from base_link to lidar, but from the odometry's base_footprint: give --base-frame"),
        (
            "radar",
            "from base_link to radar, but between base_footprint, lidar: set header.frame_id to the sensor's frame",
        ),
    ],
)
def test_positions_that_cannot_be_moved_to_the_body_are_told_what_helps(tmp_path, monkeypatch, capsys, frame, remedy):
    write_boxes_over_a_footprint(tmp_path / "source", frame)
    with pytest.raises(InputError, match="nothing on /lidar/boxes"):
        run_import(monkeypatch, "bag", tmp_path / "source", "--out", tmp_path / "bag")
    told = capsys.readouterr().out
    assert remedy in told and "perception.extrinsics" not in told


def test_where_the_body_is_in_no_transform_those_there_are_are_told(tmp_path, monkeypatch, capsys):
    with UserBag(tmp_path / "source", "vision_3d") as bag:
        bag.write("/odom", bag.odometry(SECOND, 0.0), SECOND)
        bag.write("/tf_static", bag.transform(SECOND, "chassis", "lidar", (0, 0, 1)), SECOND)
        bag.write("/lidar/boxes", bag.vision_3d(SECOND, [("car", (1.0, 2.0, 3.0))], 0.1, "lidar"), SECOND)
    with pytest.raises(InputError, match="nothing on /lidar/boxes"):
        run_import(monkeypatch, "bag", tmp_path / "source", "--out", tmp_path / "bag")
    assert "from base_link to lidar, but between chassis, lidar: give --base-frame" in capsys.readouterr().out


def test_positions_are_moved_to_the_body_that_is_named_and_a_run_is_to_know_it(tmp_path, monkeypatch, capsys):
    write_boxes_over_a_footprint(tmp_path / "source", "lidar")
    run_import(monkeypatch, "bag", tmp_path / "source", "--out", tmp_path / "bag", "--base-frame", "base_footprint")
    (found,) = read_bag(tmp_path / "bag")["/detections"]
    np.testing.assert_allclose(found.positions, [[1.0, 2.0, 4.0]])
    assert "of 'base_footprint': set perception.base_frame: base_footprint" in capsys.readouterr().out


def test_positions_of_another_body_than_the_odometry_are_to_be_imported_again(tmp_path, monkeypatch, capsys):
    write_boxes_over_a_footprint(tmp_path / "source", "base_link")
    run_import(monkeypatch, "bag", tmp_path / "source", "--out", tmp_path / "bag")
    again = "import again with --base-frame base_footprint and set perception.base_frame: base_footprint"
    assert again in capsys.readouterr().out


def test_boxes_need_no_second_import_where_the_odometry_is_of_another_body(tmp_path, monkeypatch, capsys):
    source = write_drive(tmp_path / "source", frames=1)
    with BagReader(source) as reader, UserBag(tmp_path / "footprint") as bag:
        for message in reader.messages():
            value = reader.decode(message.cdr, message.type_name)
            if message.topic == "/odometry/filtered":
                value.child_frame_id = "base_footprint"
            bag.write(message.topic, value, message.stamp_ns)
    run_import(monkeypatch, "bag", tmp_path / "footprint", "--out", tmp_path / "bag")
    told = capsys.readouterr().out
    assert "set perception.base_frame: base_footprint" in told and "--base-frame" not in told


@pytest.mark.parametrize("flag", ["--image", "--depth", "--camera-info"])
def test_a_camera_that_is_named_beside_positions_is_refused(tmp_path, monkeypatch, flag):
    write_boxes_over_a_footprint(tmp_path / "source", "base_link")
    with pytest.raises(InputError, match=rf"{flag} /camera would not be used, as /lidar/boxes .* tells positions"):
        run_import(monkeypatch, "bag", tmp_path / "source", "--out", tmp_path / "bag", flag, "/camera")
