"""The topics of a user's own bag: found by type or by name, and passed on under the names that nodes use."""

import numpy as np
import pytest
from worlds.bags.imported import import_bag, merge_bags, read_bag, run_import
from worlds.bags.user_bag_factory import SECOND, Seen, UserBag, write_drive

from semantic_slam.bag.reader import BagReader
from semantic_slam.bag.writer import BagWriter
from semantic_slam.errors import InputError
from semantic_slam.messages.inertial import imu_message


def test_topics_arrive_under_the_names_that_nodes_use(tmp_path, monkeypatch):
    source = write_drive(tmp_path / "source", frames=4)
    bag = import_bag(monkeypatch, "bag", source, "--out", tmp_path / "bag")
    counts = {topic: len(messages) for topic, messages in bag.items()}
    assert counts == {
        "/tf_static": 1,
        "/odom": 4,
        "/camera_info": 4,
        "/image/compressed": 4,
        "/depth/compressed": 4,
        "/detections": 4,
    }
    assert bag["/odom"][3].pose[0] == pytest.approx(0.3)


def test_a_topic_that_is_missing_is_answered_with_those_there_are(tmp_path, monkeypatch):
    source = write_drive(tmp_path / "source")
    with pytest.raises(InputError, match=r"no messages on --image /nope; .*/camera/color/image_raw \(sensor_msgs"):
        run_import(monkeypatch, "bag", source, "--out", tmp_path / "bag", "--image", "/nope")
    with pytest.raises(InputError, match=r"--odom /camera/color/camera_info .* must be of type nav_msgs/msg/Odometry"):
        run_import(monkeypatch, "bag", source, "--out", tmp_path / "bag", "--odom", "/camera/color/camera_info")
    assert not (tmp_path / "bag").exists()


def test_two_detectors_need_a_choice(tmp_path, monkeypatch):
    source = write_drive(tmp_path / "source", frames=1)
    with UserBag(tmp_path / "other") as bag:
        bag.write("/tracker/boxes", bag.vision_4(SECOND, [Seen("dog", 30.0, "9")]), SECOND)
    merge_bags(tmp_path / "both", source, tmp_path / "other")
    with pytest.raises(InputError, match=r"--detections could be any of /detector/boxes .*, /tracker/boxes"):
        run_import(monkeypatch, "bag", tmp_path / "both", "--out", tmp_path / "bag")
    run_import(monkeypatch, "bag", tmp_path / "both", "--out", tmp_path / "bag", "--detections", "tracker/boxes")
    assert read_bag(tmp_path / "bag")["/detections"][0].labels == ("dog",)


def test_the_only_inertial_sensor_is_taken_and_of_several_the_one_that_is_named(tmp_path, monkeypatch, capsys):
    source = write_drive(tmp_path / "source", frames=2)
    for name, sensors in (("one", ["/camera/imu"]), ("two", ["/camera/imu", "/base/imu"])):
        with BagWriter(tmp_path / name) as bag:
            for number, topic in enumerate(sensors):
                bag.write(topic, imu_message(SECOND, "imu_link", np.array([0.0, number, 9.81])), SECOND)
        merge_bags(tmp_path / f"with_{name}", source, tmp_path / name)
    run_import(monkeypatch, "bag", tmp_path / "with_one", "--out", tmp_path / "bag_one")
    assert len(read_bag(tmp_path / "bag_one")["/imu"]) == 1
    assert "imu /camera/imu (sensor_msgs/msg/Imu)" in capsys.readouterr().out
    run_import(monkeypatch, "bag", tmp_path / "with_two", "--out", tmp_path / "bag_two")
    assert "/imu" not in read_bag(tmp_path / "bag_two") and "/base/imu 1" in capsys.readouterr().out
    run_import(monkeypatch, "bag", tmp_path / "with_two", "--out", tmp_path / "bag_base", "--imu", "/base/imu")
    assert read_bag(tmp_path / "bag_base")["/imu"][0].linear_acceleration.y == 1.0


def test_ground_truth_and_initial_pose_are_passed_on_byte_for_byte(tmp_path, monkeypatch):
    source = write_drive(tmp_path / "source", frames=1)
    with UserBag(tmp_path / "more") as bag:
        truth = bag.odometry(SECOND, 4.0)
        bag.write("/ground_truth/odom", truth, SECOND)
        start = bag.make(
            "geometry_msgs/msg/PoseWithCovarianceStamped",
            header=bag.header(SECOND, "map"),
            pose=bag.covariance_pose(bag.pose(3.0)),
        )
        bag.write("/initialpose", start, SECOND)
    merge_bags(tmp_path / "both", source, tmp_path / "more")
    bag = import_bag(monkeypatch, "bag", tmp_path / "both", "--out", tmp_path / "bag")
    assert bag["/ground_truth/odom"][0].pose[0] == 4.0
    assert bag["/initialpose"][0].pose[0] == 3.0
    assert len(bag["/odom"]) == 1  # the ground truth was not mistaken for odometry


def test_max_keyframes_counts_detection_messages(tmp_path, monkeypatch):
    run_import(monkeypatch, "bag", write_drive(tmp_path / "source"), "--out", tmp_path / "bag", "--max-keyframes", 2)
    assert len(read_bag(tmp_path / "bag")["/detections"]) == 2


def test_the_source_is_never_overwritten(tmp_path, monkeypatch):
    source = write_drive(tmp_path / "source")
    with pytest.raises(InputError, match="is an input of this command"):
        run_import(monkeypatch, "bag", source, "--out", source)
    with BagReader(source) as reader:
        assert len(reader.topics) == 6


def test_a_truncated_bag_gives_what_comes_before_the_damage(tmp_path, monkeypatch, capsys):
    source = write_drive(tmp_path / "source", frames=20)
    (storage,) = source.glob("*.mcap")
    storage.write_bytes(storage.read_bytes()[: storage.stat().st_size * 2 // 3])
    with pytest.raises(InputError, match="damaged"):
        run_import(monkeypatch, "bag", source, "--out", tmp_path / "bag")
    assert 0 < len(read_bag(tmp_path / "bag")["/detections"]) < 20
    assert "/detections" in capsys.readouterr().out
