"""From an input bag to a belief bag and its report, in this process."""

import dataclasses
import json
import sys

import cv2
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from worlds.bags.bag_factory import (
    OBJECTS,
    SPEED_M,
    START,
    Entry,
    frame_stamp,
    input_entries,
    map_prior,
    of_topic,
    without,
    write_bag,
    write_configuration,
)
from worlds.bags.imported import messages_of
from worlds.bags.raw_image import raw_image
from worlds.bags.stereo import by_stereo, disparity_message

from semantic_slam.bag.reader import BagReader
from semantic_slam.bag.writer import BagWriter
from semantic_slam.cli import bag_to_report
from semantic_slam.configuration import load_configuration
from semantic_slam.doctor.bag_summary import summarise_bag
from semantic_slam.errors import InputError, SemanticSlamError
from semantic_slam.inference import expander
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.world.map_prior import MapPrior, read_map_prior
from semantic_slam.messages import topics
from semantic_slam.messages.codec import to_message
from semantic_slam.messages.images import decode_image
from semantic_slam.messages.standard import NANOSECONDS, PoseEstimate
from semantic_slam.messages.typestore import serialize, typestore
from semantic_slam.pipeline import recorded_views
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.pipeline.start_deadline import TOLERANCE_NS

NUM_FRAMES = 4
LATEST = START + TOLERANCE_NS
"""Log time of the last pose that is the start: the first frame is logged at START, and odometry before it."""


@pytest.fixture(scope="module")
def configuration(tmp_path_factory):
    return load_configuration(write_configuration(tmp_path_factory.mktemp("configuration")))


@pytest.fixture
def bag(tmp_path):
    return write_bag(tmp_path / "bag", input_entries(NUM_FRAMES))


def beliefs(bag):
    return messages_of(bag, topics.BELIEF)


def raw(bag, topic):
    with BagReader(bag) as reader:
        return [item.cdr for item in reader.messages([topic])]


def test_a_bag_becomes_a_belief_bag(bag, tmp_path, configuration, capsys):
    summary = run_bag(bag, tmp_path / "belief", configuration)
    assert (summary.num_frames, summary.num_keyframes, summary.dropped, summary.fault) == (4, 4, {}, None)
    found = beliefs(tmp_path / "belief")
    assert [belief.keyframe for belief in found] == [0, 1, 2, 3]
    assert [belief.stamp_ns for belief in found] == [frame_stamp(k) for k in range(4)]
    assert capsys.readouterr().out == f"map prior: {bag / 'objects.json'}\n"


def test_the_belief_is_that_of_the_world(bag, tmp_path, configuration):
    run_bag(bag, tmp_path / "belief", configuration)
    last = beliefs(tmp_path / "belief")[-1]
    best = int(np.argmax(last.log_weights))
    assert last.log_weights[best] > np.log(0.9)
    assert last.object_ids[last.associations[best]].tolist() == [1, 2]
    np.testing.assert_allclose(last.poses[best, :2], [SPEED_M * (NUM_FRAMES - 1), 0.0], atol=0.1)
    np.testing.assert_allclose(last.object_poses[:, :2], OBJECTS[:, :2], atol=0.1)


def test_the_measurements_are_those_of_the_world(bag, tmp_path, configuration):
    run_bag(bag, tmp_path / "belief", configuration)
    measured = messages_of(tmp_path / "belief", topics.MEASUREMENTS)
    assert [item.sequence for item in measured] == [0, 1, 2, 3]
    for k, item in enumerate(measured):
        offsets = OBJECTS[:, :2] - [SPEED_M * k, 0.0]
        np.testing.assert_allclose(item.ranges_m, np.linalg.norm(offsets, axis=1), atol=0.02)
        np.testing.assert_allclose(item.bearings_rad, np.arctan2(offsets[:, 1], offsets[:, 0]), atol=0.01)
        assert item.class_probability_samples.shape == (2, 5, 2)


def test_what_a_report_needs_is_in_the_belief_bag(bag, tmp_path, configuration):
    run_bag(bag, tmp_path / "belief", configuration)
    for topic in (topics.ODOMETRY, topics.GROUND_TRUTH_OBJECTS, topics.GROUND_TRUTH_ASSOCIATIONS, topics.TF_STATIC):
        assert raw(tmp_path / "belief", topic) == raw(bag, topic)
    (run,) = messages_of(tmp_path / "belief", topics.RUN_CONFIGURATION)
    with BagReader(bag) as reader:
        assert json.loads(run.source) == {"path": str(bag), "sha256": reader.sha256()}
    assert run.stamp_ns == frame_stamp(0)
    assert json.loads(run.configuration)["perception"]["num_passes"] == 5
    assert run.revision


@pytest.mark.parametrize("num_backends", [1, 3])
def test_a_run_repeats_bit_by_bit_with_any_number_of_backends(bag, tmp_path, configuration, num_backends):
    run_bag(bag, tmp_path / "first", configuration)
    run_bag(bag, tmp_path / "second", configuration, pool=InProcessPool(num_backends))
    assert raw(tmp_path / "first", topics.BELIEF) == raw(tmp_path / "second", topics.BELIEF)


def test_the_belief_bag_shows_pose_path_and_markers(bag, tmp_path, configuration, monkeypatch):
    monkeypatch.setattr(recorded_views, "EVERY", 2)
    run_bag(bag, tmp_path / "belief", configuration)
    told = beliefs(tmp_path / "belief")
    poses = messages_of(tmp_path / "belief", topics.POSE)
    with BagReader(tmp_path / "belief") as reader:
        shown = [
            (item.topic, item.stamp_ns, reader.decode(item.cdr, item.type_name))
            for item in reader.messages([topics.PATH, topics.MARKERS])
        ]
    assert [pose.stamp_ns for pose in poses] == [belief.stamp_ns for belief in told]
    paths = [(stamp, len(path.poses)) for topic, stamp, path in shown if topic == topics.PATH]
    assert paths == [(frame_stamp(0), 1), (frame_stamp(2), 3), (frame_stamp(3), 4)]
    markers = [message for topic, _, message in shown if topic == topics.MARKERS]
    assert len(markers) == 3 and {marker.ns for marker in markers[-1].markers} == {"objects", "classes"}


def test_recorded_measurements_need_no_images(bag, tmp_path, configuration):
    run_bag(bag, tmp_path / "belief", configuration)
    recorded = tmp_path / "recorded"
    with BagReader(tmp_path / "belief") as reader, BagWriter(recorded) as writer:
        for topic, type_name, stamp, cdr in reader.messages([topics.MEASUREMENTS, topics.ODOMETRY]):
            writer.write_raw(topic, type_name, cdr, stamp)
    summary = run_bag(recorded, tmp_path / "again", configuration, map_prior())
    assert summary.num_keyframes == NUM_FRAMES
    assert raw(tmp_path / "again", topics.BELIEF) == raw(tmp_path / "belief", topics.BELIEF)


def test_recorded_measurements_that_contradict_themselves_are_counted_as_they_are_live(bag, tmp_path, configuration):
    run_bag(bag, tmp_path / "belief", configuration)
    recorded, number = tmp_path / "recorded", 0
    with BagReader(tmp_path / "belief") as reader, BagWriter(recorded) as writer:
        for topic, type_name, stamp, cdr in reader.messages([topics.MEASUREMENTS, topics.ODOMETRY]):
            content = reader.decode(cdr, type_name)
            number += topic == topics.MEASUREMENTS
            if topic == topics.MEASUREMENTS and number == 2:
                content.ranges = content.ranges[:-1]
            writer.write_raw(topic, type_name, serialize(content), stamp)
    summary = run_bag(recorded, tmp_path / "again", configuration, map_prior())
    assert summary.num_keyframes == NUM_FRAMES - 1
    assert summary.dropped == {f"{topics.MEASUREMENTS}: array ranges of another length": 1}


def test_the_run_stops_after_the_keyframes_wanted(bag, tmp_path, configuration):
    summary = run_bag(bag, tmp_path / "belief", configuration, max_keyframes=2)
    assert summary.num_keyframes == 2
    assert len(beliefs(tmp_path / "belief")) == 2


def test_without_depth_the_run_is_bearing_only(tmp_path, configuration):
    bag = write_bag(tmp_path / "bag", without(input_entries(NUM_FRAMES), topics.DEPTH_COMPRESSED))
    summary = run_bag(bag, tmp_path / "belief", configuration)
    assert (summary.num_keyframes, summary.dropped) == (NUM_FRAMES, {})
    assert np.isnan(messages_of(tmp_path / "belief", topics.MEASUREMENTS)[0].ranges_m).all()


def test_disparities_of_a_stereo_pair_are_depth(tmp_path, configuration):
    """Without any change to the bag; one that is of another size is counted, and its frame has bearings alone."""
    bags = {"depth": input_entries(NUM_FRAMES), "stereo": by_stereo(input_entries(NUM_FRAMES))}
    (*_, last) = of_topic(bags["stereo"], topics.DISPARITY)
    last.message = disparity_message(last.message.header, np.ones((2, 2)))
    measured = {}
    for name, entries in bags.items():
        summary = run_bag(write_bag(tmp_path / name, entries), tmp_path / f"belief_{name}", configuration)
        measured[name] = messages_of(tmp_path / f"belief_{name}", topics.MEASUREMENTS)
    assert list(summary.dropped) == [f"{topics.DISPARITY}: size 2 x 2 is not the 160 x 120 of {topics.CAMERA_INFO}"]
    for own, wanted in list(zip(measured["stereo"], measured["depth"], strict=True))[:-1]:
        np.testing.assert_allclose(own.ranges_m, wanted.ranges_m, atol=1e-5)
    assert np.isnan(measured["stereo"][-1].ranges_m).all() and np.isfinite(measured["depth"][-1].ranges_m).all()


@pytest.mark.parametrize(("log_ns", "is_start"), [(START - NANOSECONDS, True), (LATEST, True), (LATEST + 1, False)])
def test_an_initial_pose_is_the_start_unless_it_comes_after_it(tmp_path, configuration, capsys, log_ns, is_start):
    """A recorder may get a latched pose after the first frame, which is behind the first odometry."""
    pose, covariance = np.array([0.0, 0, 0, 0, 0, 0, 1]), np.diag([4.0, 4, 0, 0, 0, 1])
    start = PoseEstimate(frame_stamp(0), "map", pose, covariance)
    entries = [*input_entries(2), Entry(topics.INITIAL_POSE, to_message(start), log_ns)]
    bag = write_bag(tmp_path / "bag", entries)
    run_bag(bag, tmp_path / "belief", configuration)
    (run,) = messages_of(tmp_path / "belief", topics.RUN_CONFIGURATION)
    assert np.array_equal(run.initial_covariance, covariance) == is_start
    line = f"/initialpose: the pose of {log_ns / 1e9:.3f} s is not used, as it comes 1.0 s after odometry"
    assert (f"{bag}: {line}" in capsys.readouterr().out) != is_start
    _, found = summarise_bag(bag, configuration, None)
    assert [finding.what.startswith(line) for finding in found] == ([] if is_start else [True])


def test_a_recording_may_name_its_map_frame_as_it_likes(tmp_path, configuration):
    """As by ``map_frame:=robot1/map`` of the manager, whose parameters are not in the bag."""
    covariance = np.diag([4.0, 4, 0, 0, 0, 1])
    start = PoseEstimate(frame_stamp(0), "robot1/map", np.array([0.0, 0, 0, 0, 0, 0, 1]), covariance)
    entries = [*input_entries(1), Entry(topics.INITIAL_POSE, to_message(start), frame_stamp(0))]
    run_bag(write_bag(tmp_path / "bag", entries), tmp_path / "belief", configuration)
    (run,) = messages_of(tmp_path / "belief", topics.RUN_CONFIGURATION)
    np.testing.assert_array_equal(run.initial_covariance, covariance)


def test_an_initial_pose_in_the_frame_of_odometry_is_bad_input(tmp_path, configuration):
    start = PoseEstimate(frame_stamp(0), "odom", np.array([0.0, 0, 0, 0, 0, 0, 1]), np.eye(6))
    entries = [*input_entries(1), Entry(topics.INITIAL_POSE, to_message(start), frame_stamp(0))]
    with pytest.raises(InputError, match="initialpose: it is in 'odom'; publish it in 'map'"):
        run_bag(write_bag(tmp_path / "bag", entries), tmp_path / "belief", configuration)


def test_raw_images_in_sqlite_give_the_same_belief(tmp_path, configuration):
    lossless = input_entries(NUM_FRAMES)
    for entry in of_topic(lossless, topics.IMAGE_COMPRESSED):  # jpeg -> png, so that both bags hold the same pixels
        pixels = decode_image(entry.message, "image")
        entry.message.format, entry.message.data = "png", cv2.imencode(".png", pixels[..., ::-1])[1]
    run_bag(write_bag(tmp_path / "mcap", lossless), tmp_path / "from_mcap", configuration)
    with Writer(tmp_path / "db3", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connections = {}
        for entry in map(as_raw, lossless):
            type_name = entry.message.__msgtype__
            if entry.topic not in connections:
                connections[entry.topic] = writer.add_connection(f"/{entry.topic}", type_name, typestore=typestore())
            cdr = typestore().serialize_cdr(entry.message, type_name)
            writer.write(connections[entry.topic], entry.stamp_ns, cdr)
    run_bag(tmp_path / "db3", tmp_path / "from_sqlite", configuration, map_prior())
    assert raw(tmp_path / "from_mcap", topics.BELIEF) == raw(tmp_path / "from_sqlite", topics.BELIEF)


def as_raw(entry):
    """The entry itself, or a compressed colour image as sensor_msgs/Image on topic image."""
    if entry.topic != topics.IMAGE_COMPRESSED:
        return Entry(entry.topic.lstrip("/"), entry.message, entry.stamp_ns)
    message = raw_image(entry.message.header, decode_image(entry.message, "image"), "rgb8")
    return Entry(topics.IMAGE, message, entry.stamp_ns)


def test_given_associations_come_from_the_ground_truth(bag, tmp_path, configuration):
    given = dataclasses.replace(configuration, association="given")
    summary = run_bag(bag, tmp_path / "belief", given, MapPrior())
    assert summary.num_keyframes == NUM_FRAMES
    last = beliefs(tmp_path / "belief")[-1]
    assert last.object_names == ("1", "2")
    assert len(last.hypothesis_ids) == 1
    np.testing.assert_allclose(last.object_poses[:, :2], OBJECTS[:, :2], atol=0.3)


def test_given_associations_without_ids_are_bad_input(tmp_path, configuration):
    bag = write_bag(tmp_path / "bag", without(input_entries(2), topics.GROUND_TRUTH_ASSOCIATIONS))
    with pytest.raises(InputError, match="carry no track_ids"):
        run_bag(bag, tmp_path / "belief", dataclasses.replace(configuration, association="given"))


def test_the_input_is_never_overwritten(bag, configuration):
    for out in (bag, bag.parent / "x" / ".." / "bag"):
        with pytest.raises(InputError, match="is the input bag"):
            run_bag(bag, out, configuration)
    with pytest.raises(InputError, match="is the input bag"):
        run_bag(bag / "bag.mcap", bag, configuration)


@pytest.mark.slow
def test_the_objects_of_a_report_are_the_map_prior_of_a_later_run(bag, tmp_path, monkeypatch, capsys):
    settings = write_configuration(tmp_path / "configuration")

    def report(name, *options):
        words = ["bag_to_report", str(bag), "--out", str(tmp_path / name), "--config", str(settings), *options]
        monkeypatch.setattr(sys, "argv", words)
        with pytest.raises(SystemExit) as left:
            bag_to_report.main()
        assert left.value.code == 0, capsys.readouterr().err
        return json.loads((tmp_path / name / "report.json").read_text())

    report("first")
    found = tmp_path / "first" / "objects.json"
    second = report("second", "--map-prior", str(found), "--seed", "5", "--max-keyframes", "3")
    assert second["seed"] == 5
    assert [keyframe["k"] for keyframe in second["keyframes"]] == [0, 1, 2]
    (run,) = messages_of(tmp_path / "second" / "belief", topics.RUN_CONFIGURATION)
    assert json.loads(run.map_prior) == json.loads(read_map_prior(found).to_json())
    printed = capsys.readouterr().out.splitlines()
    for name in ("report.html", "report.json", "objects.json", "trajectory.tum"):
        assert str(tmp_path / "second" / name) in printed
        assert (tmp_path / "second" / name).stat().st_size > 0


def test_a_belief_bag_is_reported_as_it_is(bag, tmp_path, monkeypatch, capsys, configuration):
    run_bag(bag, tmp_path / "belief", configuration)
    before = (tmp_path / "belief" / "belief.mcap").read_bytes()
    monkeypatch.setattr(
        sys, "argv", ["bag_to_report", str(tmp_path / "belief"), "--out", str(tmp_path / "out"), "--seed", "3"]
    )
    with pytest.raises(SystemExit) as left:
        bag_to_report.main()
    assert left.value.code == 0
    assert "--seed has no effect" in capsys.readouterr().out
    assert len(json.loads((tmp_path / "out" / "report.json").read_text())["keyframes"]) == NUM_FRAMES
    assert (tmp_path / "belief" / "belief.mcap").read_bytes() == before
    assert not (tmp_path / "out" / "belief").exists()


def test_hypotheses_given_up_are_in_the_belief_bag_even_if_none_is_left(bag, tmp_path, configuration, monkeypatch):
    monkeypatch.setattr(
        expander, "grow", lambda parents, *_, **options: [LostComponentError("not finite")] * len(parents)
    )
    given = dataclasses.replace(configuration, association="given")
    with pytest.raises(SemanticSlamError, match="every hypothesis was lost"):
        run_bag(bag, tmp_path / "belief", given, MapPrior())
    with BagReader(tmp_path / "belief") as reader:
        last = [reader.decode(item.cdr, item.type_name) for item in reader.messages([topics.DIAGNOSTICS])][-1]
    values = {value.key: value.value for status in last.status for value in status.values}
    assert values["dropped: hypothesis lost: not finite"] == "1"
