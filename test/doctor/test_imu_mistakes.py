"""The doctor finds what is wrong with topic imu of a bag in space, and is silent where nothing is."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from semantic_slam_lab.simulation.tables import T_BODY_CAMERA, Flight, table_tops
from semantic_slam_lab.studies.tables.run import configuration
from worlds.bags.bag_factory import Entry, of_topic, without
from worlds.bags.mistakes import each, rotated
from worlds.bags.table_bag import in_space, with_imu, write_table_bag
from worlds.scenes.inertial import Imu

from semantic_slam.doctor.bag_summary import summarise_bag
from semantic_slam.doctor.examination import examine
from semantic_slam.doctor.finding import Finding
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.messages import topics
from semantic_slam.messages.standard import pose_message
from semantic_slam.messages.typestore import message_class, typestore

Entries = list[Entry]


def flown(*, tilt_rad: float | None = None) -> Entries:
    room = table_tops(
        Flight(keyframes=14, things=5), SpatialRegion.of(configuration().open_world), np.random.default_rng(5)
    )
    return with_imu(room, Imu(T_body_imu=T_BODY_CAMERA, tilt_rad=tilt_rad, rate_hz=40.0), np.random.default_rng(5))


def examined(folder: Path, entries: Entries) -> list[Finding]:
    summary, faults = summarise_bag(write_table_bag(folder / "bag", entries), in_space(), None)
    return [*faults, *(each for each in examine(summary) if each.check in ("imu", "topics", "stamps", "dropped"))]


@pytest.mark.parametrize("tilt_rad", [None, 0.01])
def test_a_bag_whose_imu_is_right_is_healthy(tmp_path: Path, tilt_rad: float | None) -> None:
    assert examined(tmp_path, flown(tilt_rad=tilt_rad)) == []


def scaled(factor: float) -> Callable[[Any], None]:
    def change(message: Any) -> None:
        told = message.linear_acceleration
        told.x, told.y, told.z = factor * told.x, factor * told.y, factor * told.z

    return change


def world_down(message: Any) -> None:
    """Orientation in a world whose z axis points down, half a turn about x."""
    told = message.orientation
    told.x, told.y, told.z, told.w = told.w, -told.z, told.y, -told.x


def begins_after(seconds: float) -> Callable[[Entries], Entries]:
    """The sensor begins so long after the first detection."""

    def cut(entries: Entries) -> Entries:
        first_ns = of_topic(entries, topics.DETECTIONS)[0].stamp_ns
        return [each for each in entries if each.topic != topics.IMU or each.stamp_ns > first_ns + round(seconds * 1e9)]

    return cut


def first_scaled(factor: float, every: int = 14) -> Callable[[Entries], Entries]:
    """Accelerations in the 0.6 s before every so manieth detection, beginning with the first, are scaled."""

    def change(entries: Entries) -> Entries:
        stamps = np.array([entry.stamp_ns for entry in of_topic(entries, topics.DETECTIONS)][::every])
        for entry in of_topic(entries, topics.IMU):
            if ((entry.stamp_ns <= stamps) & (entry.stamp_ns > stamps - 600_000_000)).any():
                scaled(factor)(entry.message)
        return entries

    return change


def renamed(entries: Entries) -> Entries:
    for entry in of_topic(entries, topics.IMU):
        entry.topic = "/camera/imu"
    return entries


def retyped(entries: Entries) -> Entries:
    pose = message_class("geometry_msgs/msg/PoseStamped")
    for entry in of_topic(entries, topics.IMU):
        entry.message = pose(header=entry.message.header, pose=pose_message(np.array([0, 0, 0, 0, 0, 0, 1.0])))
    return entries


@pytest.mark.parametrize(
    ("plant", "words"),
    [
        (renamed, "warning: topics: /camera/imu: inertial sensors that nobody reads"),
        (retyped, "error: imu: /imu is geometry_msgs/msg/PoseStamped, not sensor_msgs/msg/Imu"),
        (lambda e: without(e, topics.TF_STATIC), "error: imu: no transform from 'base_link' to 'imu_link'"),
        (each(topics.TF_STATIC, rotated(0.0, 0.0, 0.0, 1.0)), "warning: imu: /imu: up is along -y of the body"),
        (each(topics.TF_STATIC, rotated(0.5, 0.5, 0.5, 0.5)), "error: imu: /imu: up is along -z of the body"),
        (each(topics.IMU, scaled(-1.0)), "error: imu: /imu: up is along -z of the body"),
        (each(topics.IMU, scaled(1.0 / 9.81)), "error: imu: /imu: accelerations come to 1.00 m/s^2 on average"),
        (first_scaled(0.0), "warning: imu: /imu measures gravity at keyframe 1 first, of 14 keyframes (neither"),
        (first_scaled(1.4), "warning: imu: /imu measures gravity at keyframe 1 first, of 14 keyframes (acceler"),
        (first_scaled(1.4, every=3), "warning: imu: /imu measures gravity at 9 of 14 keyframes (accelerations that"),
    ],
)
def test_each_mistake_is_found_alone(tmp_path: Path, plant: Callable[[Entries], Entries], words: str) -> None:
    (found,) = examined(tmp_path, plant(flown()))
    assert found.line.startswith(words) and found.remedy


def test_a_sensor_without_a_single_message_is_told_once(tmp_path: Path) -> None:
    spoken, silent = write_table_bag(tmp_path / "spoken", without(flown(), topics.IMU)), tmp_path / "silent"
    with Reader(spoken) as reader, Writer(silent, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        kinds = [(own.topic, own.msgtype) for own in reader.connections] + [(topics.IMU, "sensor_msgs/msg/Imu")]
        to = {topic: writer.add_connection(topic, kind, typestore=typestore()) for topic, kind in kinds}
        for own, stamp_ns, data in reader.messages():
            writer.write(to[own.topic], stamp_ns, data)
    summary, _ = summarise_bag(silent, in_space(), None)
    (found,) = [own for own in examine(summary) if own.check in ("imu", "topics", "stamps", "dropped")]
    assert found.line.startswith("error: topics: /imu is there and has no message")


def test_an_orientation_in_a_world_with_z_down_is_told_by_accelerations(tmp_path: Path) -> None:
    found = examined(tmp_path, each(topics.IMU, world_down)(flown(tilt_rad=0.01)))
    assert [finding.check for finding in found] == ["imu", "imu"]
    assert "up by its orientation is 179 deg off up by its accelerations; give orientations" in found[0].line


def test_a_sensor_that_begins_late_is_told_with_what_it_costs(tmp_path: Path) -> None:
    """Beside the warning that two of fourteen keyframes had no message."""
    first, second = examined(tmp_path, begins_after(5.5)(flown()))
    assert first.what.startswith("/imu measures gravity at keyframe 2 first, of 14 keyframes (no message within")
    assert "until then roll and pitch are known to 0.5 rad alone" in first.remedy
    assert second.check == "dropped" and second.remedy.startswith("record imu and odom at their full rates")


def test_frames_before_a_sensor_that_begins_soon_are_told_with_their_remedy(tmp_path: Path) -> None:
    (found,) = examined(tmp_path, begins_after(4.0)(flown()))
    assert "just before imu is heard" in found.what and found.remedy.startswith("start the sensor before")
