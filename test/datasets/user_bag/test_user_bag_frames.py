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
