"""A user's own bag: any detector's boxes, raw or compressed images, odometry or TF, become an input bag."""

import struct
import sys

import cv2
import numpy as np
import pytest
from worlds.bags.user_bag_factory import FOCAL, HEIGHT, SECOND, WIDTH, Seen, UserBag, picture, write_drive

from semantic_slam.bag.reader import BagReader
from semantic_slam.bag.writer import BagWriter
from semantic_slam.cli import import_dataset
from semantic_slam.datasets.user_bag.image_formats import to_millimetres
from semantic_slam.datasets.user_bag.label_map import read_label_map
from semantic_slam.errors import InputError
from semantic_slam.messages.codec import CODECS, from_message
from semantic_slam.messages.inertial import imu_message
from semantic_slam.messages.typestore import message_class

OUR_TYPES = {codec.type_name for codec in CODECS.values()}


def run_command(monkeypatch, *words):
    monkeypatch.setattr(sys, "argv", ["import_dataset", "bag", *map(str, words)])
    import_dataset.command()


def read_bag(path):
    """Topic -> messages, ours as dataclasses, in the order of the bag."""
    values = {}
    with BagReader(path) as reader:
        for message in reader.messages():
            value = reader.decode(message.cdr, message.type_name)
            value = from_message(value) if message.type_name in OUR_TYPES else value
            values.setdefault(message.topic, []).append(value)
    return values


def decoded(message):
    return cv2.imdecode(np.asarray(message.data), cv2.IMREAD_UNCHANGED)


@pytest.mark.parametrize("detector", ["vision_4", "vision_2", "yolo"])
def test_boxes_of_every_detector_are_read(tmp_path, monkeypatch, detector):
    source = write_drive(tmp_path / "source", detector=detector, track_ids=("5", ""))
    run_command(monkeypatch, source, "--out", tmp_path / "bag")
    first = read_bag(tmp_path / "bag")["/detections"][0]
    u = 80 + FOCAL * 0.5 / 3.0  # an object 0.5 m to the right and 3 m ahead
    assert first.stamp_ns == SECOND
    assert first.frame_id == "camera_optical_frame"
    assert first.labels == ("cup", "bottle")
    assert first.track_ids == ("5", "")
    np.testing.assert_allclose(first.boxes[0], [u - 12, 48, u + 12, 72])
    np.testing.assert_allclose(first.scores, [0.9, 0.9])


def test_topics_arrive_under_the_names_that_nodes_use(tmp_path, monkeypatch):
    source = write_drive(tmp_path / "source", frames=4)
    run_command(monkeypatch, source, "--out", tmp_path / "bag")
    bag = read_bag(tmp_path / "bag")
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


def test_raw_colour_keeps_its_colours(tmp_path, monkeypatch):
    run_command(monkeypatch, write_drive(tmp_path / "source"), "--out", tmp_path / "bag")
    image = decoded(read_bag(tmp_path / "bag")["/image/compressed"][0])
    rgb = cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
    assert np.abs(rgb.astype(int) - picture(0)).mean() < 4.0  # JPEG; swapped channels give more than 50


@pytest.mark.parametrize("kind", ["16UC1", "32FC1", "compressedDepth"])
def test_depth_becomes_millimetres(tmp_path, monkeypatch, kind):
    run_command(monkeypatch, write_drive(tmp_path / "source", depth=kind), "--out", tmp_path / "bag")
    depth = decoded(read_bag(tmp_path / "bag")["/depth/compressed"][1])
    assert depth.dtype == np.uint16
    assert depth[0, 0] == 0  # was NaN
    np.testing.assert_allclose(depth[1:], 2900, atol=1)


def test_inverse_depth_of_compressed_depth_transport(tmp_path, monkeypatch):
    # 32FC1 travels as q = scale / depth + offset: 2 m with scale 1000 and offset 10 is q = 510; q = 0 is invalid.
    source = write_drive(tmp_path / "source", frames=1, depth="")
    quantised = np.full((HEIGHT, WIDTH), 510, dtype=np.uint16)
    quantised[0, 0] = 0
    with UserBag(tmp_path / "depth") as bag:
        header = struct.pack("<iff", 0, 1000.0, 10.0)
        message = bag.compressed(SECOND, quantised, ".png", "32FC1; compressedDepth png", header)
        bag.write("/depth/compressedDepth", message, SECOND)
    merge(tmp_path / "both", source, tmp_path / "depth")
    run_command(monkeypatch, tmp_path / "both", "--out", tmp_path / "bag")
    depth = decoded(read_bag(tmp_path / "bag")["/depth/compressed"][0])
    assert depth[0, 0] == 0
    assert (depth[1:] == 2000).all()


def merge(out, *parts):
    """One bag of several, with the definitions of all."""
    from semantic_slam.bag.writer import BagWriter

    with BagWriter(out) as writer:
        for part in parts:
            with BagReader(part) as reader:
                for message in reader.messages():
                    definition = reader.definitions[message.type_name]
                    writer.write_raw(message.topic, message.type_name, message.cdr, message.stamp_ns, definition)


def test_depth_beyond_what_16_bits_hold_is_invalid():
    metres = np.array([[0.0, -1.0, np.nan, np.inf, 65.535, 65.536, 1.2344]], dtype=np.float32)
    np.testing.assert_array_equal(to_millimetres(metres), [[0, 0, 0, 0, 65535, 0, 1234]])


def test_without_depth_none_is_written(tmp_path, monkeypatch, capsys):
    run_command(monkeypatch, write_drive(tmp_path / "source", depth=""), "--out", tmp_path / "bag")
    assert "/depth/compressed" not in read_bag(tmp_path / "bag")
    assert "bearing only" in capsys.readouterr().out


def test_depth_can_be_left_out_and_is_then_counted(tmp_path, monkeypatch, capsys):
    run_command(monkeypatch, write_drive(tmp_path / "source", frames=3), "--out", tmp_path / "bag", "--depth", "none")
    assert "/depth/compressed" not in read_bag(tmp_path / "bag")
    assert "not needed: /camera/aligned_depth/image_raw 3" in capsys.readouterr().out


def test_odometry_from_tf_over_a_fixed_transform(tmp_path, monkeypatch):
    source = write_drive(tmp_path / "source", frames=1, static=False)
    quarter_turn = (0, 0, np.sqrt(0.5), np.sqrt(0.5))
    with UserBag(tmp_path / "tf") as bag:
        bag.write("/tf", bag.transform(SECOND, "map", "odom", (9, 9, 0)), SECOND)
        bag.write("/tf", bag.transform(SECOND, "odom", "base_footprint", (1, 2, 0), quarter_turn), SECOND)
        # written later than the transform that needs it
        bag.write("/tf_static", bag.transform(SECOND, "base_footprint", "base_link", (0.5, 0, 0.1)), 2 * SECOND)
    merge(tmp_path / "both", source, tmp_path / "tf")
    run_command(monkeypatch, tmp_path / "both", "--out", tmp_path / "bag", "--odom", "/tf")
    (odometry,) = read_bag(tmp_path / "bag")["/odom"]
    # base_link lies 0.5 m ahead of base_footprint, which looks along odom's y.
    np.testing.assert_allclose(odometry.pose, [1, 2.5, 0.1, *quarter_turn], atol=1e-12)
    assert (odometry.frame_id, odometry.child_frame_id) == ("odom", "base_link")


def test_tf_without_the_frames_names_those_it_has(tmp_path, monkeypatch):
    source = write_drive(tmp_path / "source", frames=1)
    with UserBag(tmp_path / "tf") as bag:
        bag.write("/tf", bag.transform(SECOND, "world", "robot", (1, 2, 0)), SECOND)
    merge(tmp_path / "both", source, tmp_path / "tf")
    with pytest.raises(InputError, match=r"lacks odom -> base_link but has world -> robot; .*--odom-frame"):
        run_command(monkeypatch, tmp_path / "both", "--out", tmp_path / "bag", "--odom", "/tf")
    run_command(
        monkeypatch, tmp_path / "both", "--out", tmp_path / "bag", "--odom", "/tf",
        "--odom-frame", "world", "--base-frame", "robot",
    )  # fmt: skip
    assert len(read_bag(tmp_path / "bag")["/odom"]) == 1


def test_labels_are_mapped_dropped_and_unknown_ones_named(tmp_path, monkeypatch, capsys):
    labels = tmp_path / "labels.yaml"
    labels.write_text("cup: mug\nperson: null\n")
    source = write_drive(tmp_path / "source", frames=3)
    run_command(monkeypatch, source, "--out", tmp_path / "bag", "--labels", labels)
    frames = read_bag(tmp_path / "bag")["/detections"]
    assert [frame.labels for frame in frames] == [("mug",)] * 3
    assert [frame.track_ids for frame in frames] == [("a",)] * 3
    assert frames[0].boxes.shape == (1, 4)
    assert "label not listed in the label file: bottle 3" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("- cup", "mapping"),
        ("", "mapping"),
        ("cup: [1, 2]", "not a label"),
        ("on: mug", "quotes"),
        ("cup: !!python/object/apply:os.system ['true']", "not a readable YAML"),
    ],
)
def test_a_label_file_with_a_fault_is_refused(tmp_path, text, fault):
    path = tmp_path / "labels.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=fault) as raised:
        read_label_map(path)
    assert str(path) in str(raised.value)
    assert "\n" not in str(raised.value)


def test_class_numbers_are_labels(tmp_path):
    path = tmp_path / "labels.yaml"
    path.write_text("7: mug\n8: null\n")
    assert read_label_map(path).mapping == {"7": "mug", "8": None}


def test_a_topic_that_is_missing_is_answered_with_those_there_are(tmp_path, monkeypatch):
    source = write_drive(tmp_path / "source")
    with pytest.raises(InputError, match=r"no messages on --image /nope; .*/camera/color/image_raw \(sensor_msgs"):
        run_command(monkeypatch, source, "--out", tmp_path / "bag", "--image", "/nope")
    with pytest.raises(InputError, match=r"--odom /camera/color/camera_info .* must be of type nav_msgs/msg/Odometry"):
        run_command(monkeypatch, source, "--out", tmp_path / "bag", "--odom", "/camera/color/camera_info")
    assert not (tmp_path / "bag").exists()


@pytest.mark.parametrize(("sigma_m", "frame"), [(0.2, "camera_optical_frame"), (0.0, "base_link")])
def test_boxes_in_space_need_neither_picture_nor_camera(tmp_path, monkeypatch, capsys, sigma_m, frame):
    with UserBag(tmp_path / "source", "vision_3d") as bag:
        bag.write("/tf_static", bag.camera_mount(), SECOND)
        bag.write("/odom", bag.odometry(SECOND, 0.0), SECOND)
        bag.write("/lidar/boxes", bag.vision_3d(SECOND, [("car", (1.0, 2.0, 3.0))], sigma_m, frame), SECOND)
    run_command(monkeypatch, tmp_path / "source", "--out", tmp_path / "bag")
    (found,) = read_bag(tmp_path / "bag")["/detections"]
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
        run_command(monkeypatch, tmp_path / "source", "--out", tmp_path / "bag")
    assert "no static transforms lead from base_link to lidar" in capsys.readouterr().out


def test_two_detectors_need_a_choice(tmp_path, monkeypatch):
    source = write_drive(tmp_path / "source", frames=1)
    with UserBag(tmp_path / "other") as bag:
        bag.write("/tracker/boxes", bag.vision_4(SECOND, [Seen("dog", 30.0, "9")]), SECOND)
    merge(tmp_path / "both", source, tmp_path / "other")
    with pytest.raises(InputError, match=r"--detections could be any of /detector/boxes .*, /tracker/boxes"):
        run_command(monkeypatch, tmp_path / "both", "--out", tmp_path / "bag")
    run_command(monkeypatch, tmp_path / "both", "--out", tmp_path / "bag", "--detections", "tracker/boxes")
    assert read_bag(tmp_path / "bag")["/detections"][0].labels == ("dog",)


def test_the_only_inertial_sensor_is_taken_and_of_several_the_one_that_is_named(tmp_path, monkeypatch, capsys):
    source = write_drive(tmp_path / "source", frames=2)
    for name, sensors in (("one", ["/camera/imu"]), ("two", ["/camera/imu", "/base/imu"])):
        with BagWriter(tmp_path / name) as bag:
            for number, topic in enumerate(sensors):
                bag.write(topic, imu_message(SECOND, "imu_link", np.array([0.0, number, 9.81])), SECOND)
        merge(tmp_path / f"with_{name}", source, tmp_path / name)
    run_command(monkeypatch, tmp_path / "with_one", "--out", tmp_path / "bag_one")
    assert len(read_bag(tmp_path / "bag_one")["/imu"]) == 1
    assert "imu /camera/imu (sensor_msgs/msg/Imu)" in capsys.readouterr().out
    run_command(monkeypatch, tmp_path / "with_two", "--out", tmp_path / "bag_two")
    assert "/imu" not in read_bag(tmp_path / "bag_two") and "/base/imu 1" in capsys.readouterr().out
    run_command(monkeypatch, tmp_path / "with_two", "--out", tmp_path / "bag_base", "--imu", "/base/imu")
    assert read_bag(tmp_path / "bag_base")["/imu"][0].linear_acceleration.y == 1.0


def test_images_that_do_not_decode_are_counted(tmp_path, monkeypatch, capsys):
    source = write_drive(tmp_path / "source", frames=2)
    with UserBag(tmp_path / "broken") as bag:
        message = bag.image(3 * SECOND, picture(0), "rgb8")
        message.data = message.data[:100]
        bag.write("/camera/color/image_raw", message, 3 * SECOND)
    merge(tmp_path / "both", source, tmp_path / "broken")
    run_command(monkeypatch, tmp_path / "both", "--out", tmp_path / "bag")
    assert len(read_bag(tmp_path / "bag")["/image/compressed"]) == 2
    assert "/camera/color/image_raw: 100 bytes are no 160 x 120 image of rgb8" in capsys.readouterr().out


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
    merge(tmp_path / "both", source, tmp_path / "more")
    run_command(monkeypatch, tmp_path / "both", "--out", tmp_path / "bag")
    bag = read_bag(tmp_path / "bag")
    assert bag["/ground_truth/odom"][0].pose[0] == 4.0
    assert bag["/initialpose"][0].pose[0] == 3.0
    assert len(bag["/odom"]) == 1  # the ground truth was not mistaken for odometry


def test_max_keyframes_counts_detection_messages(tmp_path, monkeypatch):
    run_command(monkeypatch, write_drive(tmp_path / "source"), "--out", tmp_path / "bag", "--max-keyframes", 2)
    assert len(read_bag(tmp_path / "bag")["/detections"]) == 2


def test_the_source_is_never_overwritten(tmp_path, monkeypatch):
    source = write_drive(tmp_path / "source")
    with pytest.raises(InputError, match="is an input of this command"):
        run_command(monkeypatch, source, "--out", source)
    assert len(read_bag_topics(source)) == 6


def read_bag_topics(path):
    with BagReader(path) as reader:
        return reader.topics


def test_a_truncated_bag_gives_what_comes_before_the_damage(tmp_path, monkeypatch, capsys):
    source = write_drive(tmp_path / "source", frames=20)
    (storage,) = source.glob("*.mcap")
    storage.write_bytes(storage.read_bytes()[: storage.stat().st_size * 2 // 3])
    with pytest.raises(InputError, match="damaged"):
        run_command(monkeypatch, source, "--out", tmp_path / "bag")
    assert 0 < len(read_bag(tmp_path / "bag")["/detections"]) < 20
    assert "/detections" in capsys.readouterr().out


def test_a_turned_box_is_enclosed():
    from semantic_slam.datasets.user_bag.detection_formats import axis_aligned_box

    center = message_class("geometry_msgs/msg/Pose2D")(x=50.0, y=40.0, theta=np.pi / 2)
    np.testing.assert_allclose(axis_aligned_box(center, 20.0, 10.0), [45, 30, 55, 50])


def test_all_scores_are_read_and_every_message_names_all_classes(tmp_path, monkeypatch):
    """The detector reports "unlikely" with a third of the score; another label is never reported."""
    source = write_drive(tmp_path / "source", detector="vision_4")
    run_command(monkeypatch, source, "--out", tmp_path / "bag")
    for found in read_bag(tmp_path / "bag")["/detections"]:
        assert found.class_names == ("bottle", "cup", "unlikely")
        np.testing.assert_allclose(found.class_scores, [[np.nan, 0.9, 0.3], [0.9, np.nan, 0.3]])


def test_a_detector_without_further_hypotheses_names_its_labels(tmp_path, monkeypatch):
    run_command(monkeypatch, write_drive(tmp_path / "source", detector="yolo"), "--out", tmp_path / "bag")
    (first, *_) = read_bag(tmp_path / "bag")["/detections"]
    assert first.class_names == ("bottle", "cup")
    assert np.isnan(first.class_scores).all()


def test_scores_are_renamed_with_the_labels(tmp_path, monkeypatch):
    """What is called the same adds up; what is dropped has no score."""
    labels = tmp_path / "labels.yaml"
    labels.write_text("cup: mug\nbottle: vessel\nunlikely: mug\n")
    source = write_drive(tmp_path / "source", detector="vision_4")
    run_command(monkeypatch, source, "--out", tmp_path / "bag", "--labels", labels)
    first = read_bag(tmp_path / "bag")["/detections"][0]
    assert first.labels == ("mug", "vessel") and first.class_names == ("mug", "vessel")
    np.testing.assert_allclose(first.class_scores, [[1.2, np.nan], [0.3, 0.9]])


def test_the_joint_that_carries_the_camera_is_passed_on(tmp_path, monkeypatch, capsys):
    source = write_drive(tmp_path / "source", joints=[("base_link", "head")])
    run_command(monkeypatch, source, "--out", tmp_path / "bag")
    assert len(read_bag(tmp_path / "bag")["/tf"]) == 6
    told = capsys.readouterr().out
    assert "not needed" not in told and "perception.extrinsics" not in told


def test_tf_is_left_out_where_the_camera_is_fixed(tmp_path, monkeypatch, capsys):
    source = write_drive(tmp_path / "source")
    with UserBag(tmp_path / "tf") as bag:
        bag.write("/tf", bag.transform(SECOND, "base_link", "wheel", (0, 0.2, 0)), SECOND)
    merge(tmp_path / "both", source, tmp_path / "tf")
    run_command(monkeypatch, tmp_path / "both", "--out", tmp_path / "bag")
    assert "/tf" not in read_bag(tmp_path / "bag") and "not needed: /tf 1" in capsys.readouterr().out


def test_one_tf_may_hold_the_odometry_and_carry_the_camera(tmp_path, monkeypatch):
    source = write_drive(tmp_path / "source", joints=[("odom", "base_link"), ("base_link", "head")])
    run_command(monkeypatch, source, "--out", tmp_path / "bag", "--odom", "/tf")
    bag = read_bag(tmp_path / "bag")
    assert (len(bag["/tf"]), len(bag["/odom"])) == (12, 6)


def test_a_camera_on_two_joints_is_said_to_need_one_transform(tmp_path, monkeypatch, capsys):
    source = write_drive(tmp_path / "source", joints=[("base_link", "pan"), ("pan", "tilt")])
    run_command(monkeypatch, source, "--out", tmp_path / "bag")
    told = capsys.readouterr().out
    assert "publish base_link -> camera_optical_frame on /tf" in told and "not needed: /tf 12" in told


def write_boxes_over_a_footprint(path, frame):
    """Boxes in ``frame``; odometry of base_footprint, to which the lidar 1 m above it is fixed."""
    with UserBag(path, "vision_3d") as bag:
        odometry = bag.odometry(SECOND, 0.0)
        odometry.child_frame_id = "base_footprint"
        bag.write("/odom", odometry, SECOND)
        bag.write("/tf_static", bag.transform(SECOND, "base_footprint", "lidar", (0, 0, 1)), SECOND)
        bag.write("/lidar/boxes", bag.vision_3d(SECOND, [("car", (1.0, 2.0, 3.0))], 0.1, frame), SECOND)


@pytest.mark.parametrize(
    ("frame", "remedy"),
    [
        ("", "set header.frame_id to the sensor's frame 1"),
        ("odom", "'odom', a frame of the world, are not read: publish them in the sensor's frame 1"),
        ("map", "'map', a frame of the world, are not read: publish them in the sensor's frame 1"),
        ("lidar", "lead from base_link to lidar, but from the odometry's base_footprint: give --base-frame"),
        (
            "radar",
            "from base_link to radar: record /tf_static with the bag, or publish the positions in base_link",
        ),
    ],
)
def test_positions_that_cannot_be_moved_to_the_body_are_told_what_helps(tmp_path, monkeypatch, capsys, frame, remedy):
    write_boxes_over_a_footprint(tmp_path / "source", frame)
    with pytest.raises(InputError, match="nothing on /lidar/boxes"):
        run_command(monkeypatch, tmp_path / "source", "--out", tmp_path / "bag")
    told = capsys.readouterr().out
    assert remedy in told and "perception.extrinsics" not in told


def test_positions_are_moved_to_the_body_that_is_named_and_a_run_is_to_know_it(tmp_path, monkeypatch, capsys):
    write_boxes_over_a_footprint(tmp_path / "source", "lidar")
    run_command(monkeypatch, tmp_path / "source", "--out", tmp_path / "bag", "--base-frame", "base_footprint")
    (found,) = read_bag(tmp_path / "bag")["/detections"]
    np.testing.assert_allclose(found.positions, [[1.0, 2.0, 4.0]])
    assert "set perception.base_frame: base_footprint" in capsys.readouterr().out


def test_exchanged_frames_of_the_odometry_are_to_be_exchanged(tmp_path, monkeypatch, capsys):
    source = write_drive(tmp_path / "source")
    with BagReader(source) as reader, UserBag(tmp_path / "exchanged") as bag:
        for message in reader.messages():
            value = reader.decode(message.cdr, message.type_name)
            if message.topic == "/odometry/filtered":
                value.header.frame_id, value.child_frame_id = "base_link", "odom"
            bag.write(message.topic, value, message.stamp_ns)
    run_command(monkeypatch, tmp_path / "exchanged", "--out", tmp_path / "bag")
    told = capsys.readouterr().out
    assert "exchange header.frame_id (odom) and child_frame_id" in told and "perception.base_frame" not in told


@pytest.mark.parametrize("name", ["/camera/aligned_depth/image_raw", "/nope"])
def test_depth_that_is_named_and_would_not_be_used_is_refused(tmp_path, monkeypatch, name):
    source = write_drive(tmp_path / "source", frames=1)
    with pytest.raises(InputError, match=rf"--depth {name} would not be used, as it needs colour images"):
        run_command(monkeypatch, source, "--out", tmp_path / "bag", "--image", "none", "--depth", name)
    run_command(monkeypatch, source, "--out", tmp_path / "bag", "--image", "none", "--depth", "none")
    assert "/depth/compressed" not in read_bag(tmp_path / "bag")


@pytest.mark.parametrize("flag", ["--image", "--depth", "--camera-info"])
def test_a_camera_that_is_named_beside_positions_is_refused(tmp_path, monkeypatch, flag):
    write_boxes_over_a_footprint(tmp_path / "source", "base_link")
    with pytest.raises(InputError, match=rf"{flag} /camera would not be used, as /lidar/boxes .* tells positions"):
        run_command(monkeypatch, tmp_path / "source", "--out", tmp_path / "bag", flag, "/camera")
