"""Bad input through the real command line: one clear line and exit code 2, or a count in the report; never silence."""

import json
import sys

import numpy as np
import pytest
from worlds.bags.bag_factory import (
    frame_stamp,
    input_entries,
    noisy,
    of_topic,
    without,
    write_bag,
    write_configuration,
)
from worlds.processes.commands import call
from worlds.views.synthetic_views import FEATURES, spherical_samples

from semantic_slam.bag.reader import BagReader
from semantic_slam.cli import bag_to_report
from semantic_slam.messages import topics
from semantic_slam.messages.standard import time_message
from semantic_slam.training.viewpoint.regression import fit_class
from semantic_slam.viewpoint.spherical_process import SphericalProcessModel
from semantic_slam.viewpoint.store import save_model

NUM_FRAMES = 5


@pytest.fixture
def command(tmp_path, monkeypatch, capsys):
    """Runs ``bag_to_report`` on entries or a path; returns exit code, lines on stderr and the report, if any."""

    def run(bag, *options, configuration=None):
        path = bag if not isinstance(bag, list) else write_bag(tmp_path / "bag", bag)
        configuration = configuration or write_configuration(tmp_path / "configuration")
        out = tmp_path / "out"
        words = ["bag_to_report", str(path), "--out", str(out), "--config", str(configuration), *options]
        monkeypatch.setattr(sys, "argv", words)
        with pytest.raises(SystemExit) as left:
            bag_to_report.main()
        stderr = capsys.readouterr().err
        report = out / "report.json"
        return left.value.code, _without_progress(stderr), json.loads(report.read_text()) if report.exists() else None

    return run


def _without_progress(stderr):
    """Lines that a person sees besides the progress display, which overwrites itself and ends in a newline."""
    lines = [line.rsplit("\r", 1)[-1] for line in stderr.splitlines()]
    return [line for line in lines if line.strip() and not line.lstrip().startswith("frames:")]


def stamps(report):
    return [keyframe["stamp_ns"] for keyframe in report["keyframes"]]


def all_but(*missing):
    return [frame_stamp(k) for k in range(NUM_FRAMES) if k not in missing]


def test_good_input_drops_nothing(command):
    code, lines, report = command(input_entries(NUM_FRAMES))
    assert (code, lines) == (0, [])
    assert stamps(report) == all_but()
    assert report["dropped"] == {}


@pytest.mark.slow
def test_a_truncated_mcap_is_reported_up_to_the_damage(tmp_path):
    bag = write_bag(tmp_path / "bag", noisy(input_entries(24)))  # 0.6 MB, in blocks of 128 kB
    data = (bag / "bag.mcap").read_bytes()
    (bag / "bag.mcap").write_bytes(data[: int(0.6 * len(data))])
    configuration, out = write_configuration(tmp_path / "configuration"), tmp_path / "out"
    result = call(tmp_path, "semantic_slam.cli.bag_to_report", bag, "--out", out, "--config", configuration)
    assert result.returncode == 2
    (line,) = _without_progress(result.stderr)
    assert line.startswith(f"{bag}: the bag is damaged (")
    assert "record it again" in line
    report = json.loads((out / "report.json").read_text())
    assert 6 <= len(report["keyframes"]) < 24
    assert stamps(report) == [frame_stamp(k) for k in range(len(report["keyframes"]))]
    assert (out / "report.html").exists()


def test_a_damaged_belief_bag_is_reported_too(command, tmp_path):
    code, _, report = command(input_entries(NUM_FRAMES))
    belief = tmp_path / "out" / "belief" / "belief.mcap"
    belief.write_bytes(belief.read_bytes()[:-40])  # the end of the index
    again = tmp_path / "again"
    belief.parent.rename(again)
    code, lines, from_damaged = command(again, "--overwrite")
    assert code == 2
    assert len(lines) == 1 and str(again) in lines[0] and "damaged" in lines[0]
    assert stamps(from_damaged) == stamps(report)


@pytest.mark.parametrize(
    ("topic", "name"),
    [
        (topics.ODOMETRY, "odom (nav_msgs/msg/Odometry)"),
        (topics.DETECTIONS, "detections (semantic_slam_msgs/msg/DetectionArray)"),
        (topics.CAMERA_INFO, "camera_info (sensor_msgs/msg/CameraInfo)"),
    ],
)
def test_a_missing_topic_is_named_with_those_that_exist(command, topic, name):
    code, lines, report = command(without(input_entries(NUM_FRAMES), topic))
    assert code == 2 and report is None
    (line,) = lines
    assert f"no topic {name}" in line
    assert "/ground_truth/odom" in line


def test_a_topic_of_another_type_is_named(command):
    entries = input_entries(NUM_FRAMES)
    for entry in of_topic(entries, topics.ODOMETRY):
        entry.message = entry.message.pose.pose
    code, (line,), _ = command(entries)
    assert code == 2
    assert "/odom is geometry_msgs/msg/Pose, not nav_msgs/msg/Odometry" in line


def test_odometry_that_is_not_finite(command):
    entries = input_entries(NUM_FRAMES)
    of_topic(entries, topics.ODOMETRY)[2].message.pose.pose.position.x = float("nan")
    code, lines, report = command(entries)
    assert (code, lines) == (0, [])
    assert stamps(report) == all_but()
    assert report["dropped"] == {"odom: pose is not finite": 1}
    assert np.isfinite(report["keyframes"][-1]["best"]["pose"]).all()


@pytest.mark.parametrize(
    ("topic", "name", "lost"),
    [
        (topics.ODOMETRY, "odom", ()),
        (topics.DETECTIONS, "detections", (3,)),
        (topics.IMAGE_COMPRESSED, "image", (3,)),
    ],
)
def test_time_going_backwards(command, topic, name, lost):
    entries = input_entries(NUM_FRAMES)
    spoiled = of_topic(entries, topic)[3 if topic != topics.ODOMETRY else 4]
    spoiled.message.header.stamp = time_message(frame_stamp(1) - 7)
    code, lines, report = command(entries)
    assert (code, lines) == (0, [])
    assert stamps(report) == all_but(*lost)
    assert report["dropped"][f"{name}: time goes backwards"] == 1


def test_an_unknown_label(command, tmp_path):
    entries = input_entries(NUM_FRAMES)
    of_topic(entries, topics.DETECTIONS)[2].message.labels = ["box", "banana"]
    configuration = write_configuration(tmp_path / "labels", perception={"labels": ["box"]})
    code, lines, report = command(entries, configuration=configuration)
    assert (code, lines) == (0, [])
    assert report["dropped"] == {"unknown label 'banana'": 1}
    assert [keyframe["n_detections"] for keyframe in report["keyframes"]] == [2, 2, 1, 2, 2]


def test_an_image_that_does_not_decode(command):
    entries = input_entries(NUM_FRAMES)
    message = of_topic(entries, topics.IMAGE_COMPRESSED)[1].message
    message.data = message.data[:40]
    code, lines, report = command(entries)
    assert (code, lines) == (0, [])
    assert stamps(report) == all_but(1)
    assert report["dropped"] == {"image: an image of format 'jpeg' does not decode; send jpeg or png": 1}


def test_empty_detections(command):
    entries = input_entries(NUM_FRAMES)
    message = of_topic(entries, topics.DETECTIONS)[2].message
    message.boxes, message.scores, message.labels, message.track_ids = np.empty(0), np.empty(0), [], []
    code, lines, report = command(entries)
    assert (code, lines) == (0, [])
    assert stamps(report) == all_but(2)  # no keyframe, but its motion counts
    assert report["dropped"] == {}
    assert report["keyframes"][-1]["best"]["pose"][0] == pytest.approx(0.1 * (NUM_FRAMES - 1), abs=0.1)


@pytest.mark.parametrize(
    ("box", "reason"),
    [
        ([20.0, 30.0, 20.0, 60.0], "box without area"),
        ([20.0, 30.0, 10.0, 60.0], "box without area"),
        ([20.0, float("nan"), 40.0, 60.0], "box that is not finite"),
        ([500.0, 30.0, 520.0, 60.0], "box outside the image"),
    ],
)
def test_a_box_that_cannot_be_used(command, box, reason):
    entries = input_entries(NUM_FRAMES)
    of_topic(entries, topics.DETECTIONS)[0].message.boxes[:4] = box
    code, lines, report = command(entries)
    assert (code, lines) == (0, [])
    assert report["dropped"] == {reason: 1}
    assert [keyframe["n_detections"] for keyframe in report["keyframes"]] == [1, 2, 2, 2, 2]


def test_a_wrong_frame_id(command):
    entries = input_entries(NUM_FRAMES)
    of_topic(entries, topics.DETECTIONS)[4].message.header.frame_id = "lidar"
    code, lines, report = command(entries)
    assert (code, lines) == (0, [])
    assert stamps(report) == all_but(4)
    assert report["dropped"] == {"detections: frame id 'lidar' is not the camera's 'camera_optical_frame'": 1}


def test_a_bag_of_which_nothing_can_be_used(command):
    entries = input_entries(NUM_FRAMES)
    for entry in of_topic(entries, topics.DETECTIONS):
        entry.message.header.frame_id = "lidar"
    code, lines, report = command(entries)
    assert code == 2 and report is None
    (line,) = lines
    assert "not one keyframe could be made" in line
    assert "frame id 'lidar' is not the camera's 'camera_optical_frame' (5)" in line


def test_missing_extrinsics(command):
    code, (line,), _ = command(without(input_entries(NUM_FRAMES), topics.TF_STATIC))
    assert code == 2
    assert "from base_link to camera_optical_frame; publish /tf_static or set perception.extrinsics" in line


def test_a_bag_that_does_not_exist(command, tmp_path):
    code, lines, _ = command(tmp_path / "nowhere")
    assert code == 2
    assert lines == [f"{tmp_path / 'nowhere'}: no such bag; give a rosbag2 folder, a .mcap or a .db3"]


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--max-keyframes", "0"], "--max-keyframes 0: must be at least 1"),
        (["--seed", "-1"], "--seed -1: must be at least 0"),
        (["--seed", str(2**63)], "--seed: parameter 'seed' is 9223372036854775808; it must lie in"),
        (["--seed", "many"], "argument --seed: invalid int value: 'many'"),
        (["--map-prior", "nowhere.json"], "nowhere.json: No such file"),
        (["--frobnicate"], "unrecognized arguments: --frobnicate"),
    ],
)
def test_wrong_usage_is_one_line(command, options, text):
    code, (line,), _ = command(input_entries(1), *options)
    assert code == 2
    assert text in line


def test_an_output_folder_that_cannot_be_made(command, tmp_path):
    (tmp_path / "file").touch()
    code, (line,), _ = command(input_entries(1), "--out", str(tmp_path / "file" / "out"))
    assert code == 2
    assert "cannot be written (Not a directory); name another output folder" in line


def test_a_message_that_does_not_decode_is_counted(command, tmp_path):
    bag = write_bag(tmp_path / "bag", input_entries(NUM_FRAMES))
    entries = input_entries(NUM_FRAMES)
    code, lines, report = command(_with_broken_cdr(bag, entries, tmp_path / "broken"))
    assert (code, lines) == (0, [])
    assert stamps(report) == all_but(2)
    assert report["dropped"]["/detections: message does not decode"] == 1


def _with_broken_cdr(bag, entries, path):
    """A copy of the bag in which the detections of frame 2 are cut in the middle."""
    from semantic_slam.bag.writer import BagWriter

    with BagReader(bag) as reader, BagWriter(path) as writer:
        for topic, type_name, stamp, cdr in reader.messages():
            is_spoiled = topic == "/detections" and stamp == frame_stamp(2)
            writer.write_raw(topic, type_name, cdr[: len(cdr) // 2] if is_spoiled else cdr, stamp)
    (path / "objects.json").write_bytes((bag / "objects.json").read_bytes())
    return path


@pytest.mark.parametrize("option", [(), ("--compare",)])
def test_settings_that_do_not_go_together_are_refused_before_the_bag_is_read(command, tmp_path, option):
    """No keyframe can be made of this bag, which does not tell where the camera is."""
    blind = without(input_entries(NUM_FRAMES), topics.TF_STATIC)
    wrong = write_configuration(tmp_path / "wrong", odometry={"noise_factors": [2.0]}).rename(tmp_path / "wrong.yaml")
    code, (line,), _ = command(
        blind, *option, *([str(wrong)] if option else []), configuration=None if option else wrong
    )
    assert code == 2 and "odometry.noise_factors must be positive, and other than" in line
    assert not list((tmp_path / "out").glob("*")) and "keyframe" not in line


def test_class_models_that_tell_heights_apart_are_refused_before_the_bag_is_read(command, tmp_path):
    """No keyframe can be made of this bag, which does not tell where the camera is."""
    blind = without(input_entries(NUM_FRAMES), topics.TF_STATIC)
    models = SphericalProcessModel(("one", "two"), FEATURES, [fit_class(spherical_samples(seed)) for seed in (0, 1)])
    save_model(models, path := tmp_path / "models.safetensors", {})
    semantics = {"kind": "gp_independent", "path": str(path)}
    configured = write_configuration(tmp_path / "planar", association="open", semantic_model=semantics)
    code, (line,), _ = command(blind, configuration=configured)
    assert code == 2 and "tells heights apart, which needs state_space: spatial; set that, or fit without" in line
