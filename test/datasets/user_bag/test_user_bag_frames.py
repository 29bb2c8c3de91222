"""Frames of a user's own bag: odometry from TF, and a camera on a joint."""

import numpy as np
import pytest
from worlds.bags.imported import import_bag, merge_bags, read_bag, run_import
from worlds.bags.user_bag_factory import SECOND, UserBag, write_drive

from semantic_slam.bag.reader import BagReader
from semantic_slam.errors import InputError


def test_odometry_from_tf_over_a_fixed_transform(tmp_path, monkeypatch, capsys):
    source = write_drive(tmp_path / "source", frames=1, static=False)
    quarter_turn = (0, 0, np.sqrt(0.5), np.sqrt(0.5))
    with UserBag(tmp_path / "tf") as bag:
        bag.write("/tf", bag.transform(SECOND, "map", "odom", (9, 9, 0)), SECOND)
        for stamp_ns in (SECOND, SECOND + 1):  # the second one as an echo of the first
            bag.write("/tf", bag.transform(SECOND, "odom", "base_footprint", (1, 2, 0), quarter_turn), stamp_ns)
        # written later than the transform that needs it
        bag.write("/tf_static", bag.transform(SECOND, "base_footprint", "base_link", (0.5, 0, 0.1)), 2 * SECOND)
    merge_bags(tmp_path / "both", source, tmp_path / "tf")
    run_import(monkeypatch, "bag", tmp_path / "both", "--out", tmp_path / "bag", "--odom", "/tf")
    (odometry,) = read_bag(tmp_path / "bag")["/odom"]
    # base_link lies 0.5 m ahead of base_footprint, which looks along odom's y.
    np.testing.assert_allclose(odometry.pose, [1, 2.5, 0.1, *quarter_turn], atol=1e-12)
    assert (odometry.frame_id, odometry.child_frame_id) == ("odom", "base_link")
    assert "messages not usable: /tf: odometry of a stamp that it had before 1" in capsys.readouterr().out


def test_tf_without_the_frames_names_those_it_has(tmp_path, monkeypatch):
    source = write_drive(tmp_path / "source", frames=1)
    with UserBag(tmp_path / "tf") as bag:
        bag.write("/tf", bag.transform(SECOND, "world", "robot", (1, 2, 0)), SECOND)
    merge_bags(tmp_path / "both", source, tmp_path / "tf")
    with pytest.raises(InputError, match=r"lacks odom -> base_link but has world -> robot; .*--odom-frame"):
        run_import(monkeypatch, "bag", tmp_path / "both", "--out", tmp_path / "bag", "--odom", "/tf")
    named = ("--odom", "/tf", "--odom-frame", "world", "--base-frame", "robot")
    run_import(monkeypatch, "bag", tmp_path / "both", "--out", tmp_path / "bag", *named)
    assert len(read_bag(tmp_path / "bag")["/odom"]) == 1


def test_exchanged_frames_of_the_odometry_are_to_be_exchanged(tmp_path, monkeypatch, capsys):
    source = write_drive(tmp_path / "source")
    with BagReader(source) as reader, UserBag(tmp_path / "exchanged") as bag:
        for message in reader.messages():
            value = reader.decode(message.cdr, message.type_name)
            if message.topic == "/odometry/filtered":
                value.header.frame_id, value.child_frame_id = "base_link", "odom"
            bag.write(message.topic, value, message.stamp_ns)
    run_import(monkeypatch, "bag", tmp_path / "exchanged", "--out", tmp_path / "bag")
    told = capsys.readouterr().out
    assert "exchange header.frame_id (odom) and child_frame_id" in told and "perception.base_frame" not in told


def test_the_joint_that_carries_the_camera_is_passed_on(tmp_path, monkeypatch, capsys):
    source = write_drive(tmp_path / "source", joints=[("base_link", "head")])
    assert len(import_bag(monkeypatch, "bag", source, "--out", tmp_path / "bag")["/tf"]) == 6
    told = capsys.readouterr().out
    assert "not needed" not in told and "perception.extrinsics" not in told


def test_tf_is_left_out_where_the_camera_is_fixed(tmp_path, monkeypatch, capsys):
    source = write_drive(tmp_path / "source")
    with UserBag(tmp_path / "tf") as bag:
        bag.write("/tf", bag.transform(SECOND, "base_link", "wheel", (0, 0.2, 0)), SECOND)
    merge_bags(tmp_path / "both", source, tmp_path / "tf")
    run_import(monkeypatch, "bag", tmp_path / "both", "--out", tmp_path / "bag")
    assert "/tf" not in read_bag(tmp_path / "bag") and "not needed: /tf 1" in capsys.readouterr().out


def test_one_tf_may_hold_the_odometry_and_carry_the_camera(tmp_path, monkeypatch):
    source = write_drive(tmp_path / "source", joints=[("odom", "base_link"), ("base_link", "head")])
    run_import(monkeypatch, "bag", source, "--out", tmp_path / "bag", "--odom", "/tf")
    bag = read_bag(tmp_path / "bag")
    assert (len(bag["/tf"]), len(bag["/odom"])) == (12, 6)


def test_a_camera_on_two_joints_is_said_to_need_one_transform(tmp_path, monkeypatch, capsys):
    source = write_drive(tmp_path / "source", joints=[("base_link", "pan"), ("pan", "tilt")])
    run_import(monkeypatch, "bag", source, "--out", tmp_path / "bag")
    told = capsys.readouterr().out
    assert "publish base_link -> camera_optical_frame on /tf" in told and "not needed: /tf 12" in told


def in_namespace(path, source, robot, topics):
    """The bag with these topics below the robot's name."""
    with BagReader(source) as reader, UserBag(path) as bag:
        for message in reader.messages():
            name = f"/{robot}{message.topic}" if message.topic in topics else message.topic
            bag.write(name, reader.decode(message.cdr, message.type_name), message.stamp_ns)
    return path


def test_static_transforms_in_a_namespace_are_found(tmp_path, monkeypatch, capsys):
    source = in_namespace(tmp_path / "named", write_drive(tmp_path / "source"), "robot1", ["/tf_static"])
    bag = import_bag(monkeypatch, "bag", source, "--out", tmp_path / "bag")
    assert len(bag["/tf_static"]) == 1
    told = capsys.readouterr().out
    assert "static transforms /robot1/tf_static" in told and "not needed" not in told and "no /tf_static" not in told


def test_static_transforms_of_two_robots_need_a_choice(tmp_path, monkeypatch, capsys):
    source = in_namespace(tmp_path / "named", write_drive(tmp_path / "source"), "robot1", ["/tf_static"])
    with UserBag(tmp_path / "other") as bag:
        bag.write("/robot2/tf_static", bag.transform(SECOND, "base_link", "arm", (0, 0, 1)), SECOND)
    merge_bags(tmp_path / "both", source, tmp_path / "other")
    with pytest.raises(InputError, match=r"--tf-static could be any of /robot1/tf_static .*, /robot2/tf_static"):
        run_import(monkeypatch, "bag", tmp_path / "both", "--out", tmp_path / "bag")
    for name, child in (("/robot1/tf_static", "camera_optical_frame"), ("/robot2/tf_static", "arm")):
        folder = tmp_path / child
        run_import(monkeypatch, "bag", tmp_path / "both", "--out", folder, "--tf-static", name)
        (message,) = read_bag(folder)["/tf_static"]
        assert message.transforms[0].child_frame_id == child
    run_import(monkeypatch, "bag", tmp_path / "both", "--out", tmp_path / "without", "--tf-static", "none")
    assert "/tf_static" not in read_bag(tmp_path / "without") and "no /tf_static" in capsys.readouterr().out


def test_static_transforms_without_a_namespace_come_first(tmp_path, monkeypatch, capsys):
    with UserBag(tmp_path / "other") as bag:
        bag.write("/robot2/tf_static", bag.transform(SECOND, "base_link", "arm", (0, 0, 1)), SECOND)
    merge_bags(tmp_path / "both", write_drive(tmp_path / "source"), tmp_path / "other")
    (message,) = import_bag(monkeypatch, "bag", tmp_path / "both", "--out", tmp_path / "bag")["/tf_static"]
    assert message.transforms[0].child_frame_id == "camera_optical_frame"
    assert "not needed: /robot2/tf_static 1" in capsys.readouterr().out


def test_transforms_in_a_namespace_hold_the_odometry_and_carry_the_camera(tmp_path, monkeypatch, capsys):
    drive = write_drive(tmp_path / "drive", joints=[("odom", "base_link"), ("base_link", "head")])
    source = in_namespace(tmp_path / "named", drive, "robot1", ["/tf", "/tf_static"])
    with BagReader(source) as reader, UserBag(tmp_path / "by_tf") as bag:
        for message in reader.messages(reader.topics.keys() - {"/odometry/filtered"}):
            bag.write(message.topic, reader.decode(message.cdr, message.type_name), message.stamp_ns)
    found = import_bag(monkeypatch, "bag", tmp_path / "by_tf", "--out", tmp_path / "bag")
    assert (len(found["/tf"]), len(found["/odom"]), len(found["/tf_static"])) == (12, 6, 1)
    assert "odometry /robot1/tf (tf2_msgs" in capsys.readouterr().out
