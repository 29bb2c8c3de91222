"""The parts of the nodes that need no ROS graph: order of rounds, flow control, play list, plain views."""

import threading
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rclpy
from rclpy.serialization import deserialize_message
from scipy.spatial.transform import Rotation
from visualization_msgs.msg import MarkerArray
from worlds.belief_factory import CLASSES, small_belief

from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.geometry.transform import compose
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.messages import topics
from semantic_slam.messages.codec import encode
from semantic_slam.messages.sensor import TransformTree
from semantic_slam.messages.standard import OdometryEstimate, header_stamp_ns
from semantic_slam.messages.typestore import deserialize, serialize
from semantic_slam.pipeline.plain_views import MarkersView, pose_view
from semantic_slam.ros.node.health import Level, model_fit_status, repeated_status
from semantic_slam.ros.node.run_inputs import map_prior_of
from semantic_slam.ros.publishing.frames import Frames
from semantic_slam.ros.publishing.transforms import Transforms
from semantic_slam.ros.replay.flow_control import Credit
from semantic_slam.ros.replay.playlist import Playlist, parse_remaps


def test_credit_lets_a_window_of_frames_go_and_then_waits() -> None:
    credit = Credit(window=2, stall_s=60.0)
    assert credit.wait(0, lambda: True)
    assert credit.wait(1, lambda: True)
    threading.Timer(0.2, credit.done, [1]).start()
    assert credit.wait(2, lambda: True)
    assert credit.frames_done == 1


def test_credit_goes_on_when_nothing_moves() -> None:
    assert not Credit(window=1, stall_s=0.1).wait(1, lambda: True)


@pytest.mark.ros
@pytest.mark.parametrize("empty", ["", "empty.json"])
def test_a_manager_that_needs_a_map_and_has_none_says_so_at_its_start(
    empty: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The map may still come by a service, so it is no fault yet."""
    path = empty and str(tmp_path / empty)
    if path:
        Path(path).write_text(MapPrior(()).to_json())
    rclpy.init()
    node = rclpy.create_node("manager")
    try:
        assert map_prior_of(node, Configuration.of(association="open"), "") is None
        assert capfd.readouterr().err == ""
        assert not (prior := map_prior_of(node, Configuration(), path)) or not prior.objects
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    told = capfd.readouterr().err
    assert "association is 'enumerated'" in told and "~/load_map" in told and told.count("\n") == 1


def test_playlist_renames_and_leaves_out_what_the_nodes_publish() -> None:
    types = {
        "/camera/image": "sensor_msgs/msg/Image",
        "/detections": "semantic_slam_msgs/msg/DetectionArray",
        "/classifier/measurements": "semantic_slam_msgs/msg/SemanticMeasurementArray",
        "/clock": "rosgraph_msgs/msg/Clock",
        "/other": "unheard_msgs/msg/Of",
    }
    playlist = Playlist(types, parse_remaps(["/camera/image:=image", ""]), lambda name: "unheard" not in name)
    assert {topic: item.name for topic, item in playlist.items.items()} == {
        "/camera/image": "image",
        "/detections": "detections",
    }
    assert len(playlist.notes) == 1
    assert not playlist.has_measurements


def test_recorded_measurements_are_replayed_where_there_is_nothing_to_measure() -> None:
    types = {"/classifier/measurements": "semantic_slam_msgs/msg/SemanticMeasurementArray"}
    playlist = Playlist(types, {}, lambda name: True)
    assert playlist.has_measurements
    assert playlist.items["/classifier/measurements"].is_frame
    types["/detections"] = topics.TYPES[topics.DETECTIONS]  # without pictures, as an offline run and the launch file
    playlist = Playlist(types, {}, lambda name: True)
    assert playlist.has_measurements and list(playlist.items) == ["/classifier/measurements"]
    assert playlist.notes == ["/detections is not replayed: the recorded measurements of its detections are"]


PICTURES = (topics.IMAGE, topics.IMAGE_COMPRESSED, topics.DEPTH, topics.DEPTH_COMPRESSED, topics.DISPARITY)
OTHERS = (topics.DETECTIONS, topics.ODOMETRY, topics.CAMERA_INFO)


@pytest.mark.parametrize(
    ("pictures", "heard"),
    [
        (PICTURES, {topics.IMAGE_COMPRESSED, topics.DEPTH_COMPRESSED}),
        ((topics.IMAGE, topics.DEPTH, topics.DISPARITY), {topics.IMAGE, topics.DEPTH}),
        ((topics.IMAGE, topics.DISPARITY), {topics.IMAGE, topics.DISPARITY}),
        ((topics.DEPTH, topics.DISPARITY), set()),
    ],
)
def test_of_the_pictures_the_player_waits_for_those_that_the_classifier_reads(
    pictures: tuple[str, ...], heard: set[str]
) -> None:
    """One topic of colour, and one of its depth; neither without colour, nor with recorded measurements."""
    types = {f"/{topic}": topics.TYPES[topic] for topic in (*pictures, *OTHERS)}
    assert inputs_of(Playlist(types, {}, lambda name: True)) == {*heard, *OTHERS}
    measured = {topics.MEASUREMENTS: topics.TYPES[topics.MEASUREMENTS], **types}
    del measured["/detections"]
    assert inputs_of(Playlist(measured, {}, lambda name: True)) == {"classifier/measurements", topics.ODOMETRY}


def inputs_of(playlist: Playlist) -> set[str]:
    return {item.name for item in playlist.items.values() if item.is_input}


def test_a_disparity_of_another_type_is_nobodys_input_and_one_under_another_name_is_remapped() -> None:
    types = {"/image": topics.TYPES[topics.IMAGE], "/stereo/disparity": topics.TYPES[topics.DISPARITY]}
    remaps = parse_remaps(["/stereo/disparity:=disparity"])
    assert inputs_of(Playlist(types, remaps, lambda name: True)) == {"image", "disparity"}
    types["/stereo/disparity"] = topics.TYPES[topics.IMAGE]
    assert inputs_of(Playlist(types, remaps, lambda name: True)) == {"image"}
    wrong = {"/image": topics.TYPES[topics.IMAGE], "/depth": topics.TYPES[topics.DISPARITY]}
    assert inputs_of(Playlist(wrong, {}, lambda name: True)) == {"image", "depth"}  # nobody listens: that is told


def test_without_stereo_msgs_a_bag_with_no_other_depth_is_said_to_give_bearings_alone() -> None:
    types = {f"/{topic}": topics.TYPES[topic] for topic in (topics.IMAGE, topics.DISPARITY)}
    alone = Playlist(types, {}, lambda name: "stereo" not in name)
    note = "/disparity is not replayed: package stereo_msgs is not installed"
    assert (alone.notes, inputs_of(alone)) == ([f"{note}, so bearings alone"], {topics.IMAGE})
    types["/depth"] = topics.TYPES[topics.DEPTH]
    assert Playlist(types, {}, lambda name: "stereo" not in name).notes == [note]


@pytest.mark.parametrize("entry", ["image", ":=image", "/camera:="])
def test_remap_that_is_none_is_refused(entry: str) -> None:
    with pytest.raises(InputError, match="FROM:=TO"):
        parse_remaps([entry])


HALF = np.pi / 8
T_MAP_BODY = np.array([1.0, 2.0, 0.0, 0.0, 0.0, np.sin(HALF), np.cos(HALF)])
T_ODOM_BODY = np.array([-3.0, 0.5, 0.0, 0.0, 0.0, np.sin(-HALF / 2), np.cos(-HALF / 2)])


def odometry(stamp_ns: int, pose: np.ndarray) -> bytes:
    return encode(OdometryEstimate(stamp_ns, "/robot1/odom", "robot1/base_link", pose, np.zeros((6, 6))))


def heard(data: bytes) -> list[tuple[int, str, str, np.ndarray]]:
    """Stamp, parent, child and pose of every transform of a message."""
    tree = TransformTree()
    message = deserialize(data, topics.TYPES[topics.TF])
    tree.add(message)
    names = [(own.header.frame_id, own.child_frame_id) for own in message.transforms]
    return [(header_stamp_ns(message.transforms[0]), *name, tree.lookup(*name)) for name in names]


def test_with_every_odometry_message_map_to_odom_closes_the_chain_to_the_robot() -> None:
    """T_map_odom T_odom_body = T_map_body (REP-105), in the frame of the odometry, from the first belief on."""
    sent: list[bytes] = []
    transforms = Transforms(Frames(), sent.append)
    transforms.hear(odometry(3, T_ODOM_BODY))
    assert sent == []
    transforms.believe(T_MAP_BODY, T_ODOM_BODY)
    for stamp_ns in (4, 5):
        transforms.hear(odometry(stamp_ns, T_MAP_BODY))
    transforms.hear(b"\x00\x01\x00\x00no odometry")
    told = [own for data in sent for own in heard(data)]
    assert [own[:3] for own in told] == [(4, "map", "robot1/odom"), (5, "map", "robot1/odom")]
    for *_, T_map_odom in told:
        np.testing.assert_allclose(compose(T_map_odom, T_ODOM_BODY), T_MAP_BODY, atol=1e-12)
    transforms.begin()
    transforms.hear(odometry(6, T_ODOM_BODY))
    assert len(sent) == 2


def test_a_stamp_far_ahead_is_not_broadcast_for_tf_would_drop_all_that_follows() -> None:
    sent: list[bytes] = []
    transforms = Transforms(Frames(), sent.append)
    transforms.believe(T_MAP_BODY, T_ODOM_BODY)
    for stamp_ns in (1, 2, 3, 10**15, 4, 5):
        transforms.hear(odometry(stamp_ns, T_ODOM_BODY))
    assert [own[0] for data in sent for own in heard(data)] == [1, 2, 3, 4, 5]


def test_frames_can_be_named_and_odometry_is_broadcast_where_nobody_else_does() -> None:
    sent: list[bytes] = []
    transforms = Transforms(Frames("robot1/map", "here"), sent.append)
    transforms.broadcasts_odom = True
    transforms.hear(odometry(3, T_ODOM_BODY))
    transforms.believe(T_MAP_BODY, T_ODOM_BODY)
    transforms.hear(odometry(4, T_ODOM_BODY))
    first, second = (heard(data) for data in sent)
    assert [own[:3] for own in first] == [(3, "here", "robot1/base_link")]
    assert [own[:3] for own in second] == [(4, "robot1/map", "here"), (4, "here", "robot1/base_link")]
    np.testing.assert_allclose(second[1][3], T_ODOM_BODY, atol=1e-12)
    belief = small_belief(3, [1, 2], [1, 1], [0.75, 0.25], [4, 9], [[4], [9]])
    assert pose_view(belief, "robot1/map").frame_id == "robot1/map"
    assert {own.header.frame_id for own in MarkersView("robot1/map").of(belief).markers} == {"robot1/map"}


def test_views_of_a_belief_are_messages_that_rclpy_reads() -> None:
    belief = small_belief(3, [1, 2], [1, 1], [0.75, 0.25], [4, 9], [[4], [9]])
    estimate = pose_view(belief)
    np.testing.assert_allclose(estimate.pose[:2], np.exp(belief.log_weights) @ belief.poses[:, :2], atol=1e-12)
    markers = deserialize_message(serialize(MarkersView().of(belief)), MarkerArray).markers
    assert [(marker.ns, marker.id) for marker in markers] == [
        ("objects", 4),
        ("classes", 4),
        ("objects", 9),
        ("classes", 9),
    ]
    assert {marker.header.frame_id for marker in markers} == {"map"}
    assert all(marker.text.split()[0] in CLASSES for marker in markers if marker.ns == "classes")


def test_markers_of_objects_that_are_gone_are_deleted_once_and_others_fade_with_their_existence() -> None:
    view, belief = MarkersView(), small_belief(3, [1, 2], [1, 1], [0.75, 0.25], [4, 9], [[4], [9]])
    assert {marker.action for marker in view.of(belief).markers} == {0}
    fewer = small_belief(4, [1], [1], [1.0], [9], [[9]])
    faint = replace(fewer, existence=np.array([0.5]))
    told = [(marker.ns, marker.id, marker.action) for marker in view.of(faint).markers]
    assert told == [("objects", 9, 0), ("classes", 9, 0), ("objects", 4, 2), ("classes", 4, 2)]
    again = view.of(faint).markers
    assert [(marker.id, marker.color.a) for marker in again] == [(9, pytest.approx(0.35))] * 2


def test_an_object_in_one_of_two_places_has_an_ellipsoid_in_each_and_its_name_in_the_likelier_one() -> None:
    view, belief = MarkersView(), small_belief(0, [1, 2], [1, 1], [0.6, 0.4], [4, 9], [[4], [4]])
    means = np.array([[2.0, -1.0, 0.0], [2.0, 1.0, 0.0]])
    torn = replace(
        belief,
        place_objects=np.array([0, 0], dtype=np.uint32),
        place_probabilities=np.array([0.4, 0.6]),
        place_means=means,
        place_covariances=np.tile(0.04 * np.eye(3), (2, 1, 1)),
    )
    markers = {(own.ns, own.id): own for own in view.of(torn).markers}
    assert list(markers) == [("objects", 4), ("place_2", 4), ("classes", 4), ("objects", 9), ("classes", 9)]
    assert [markers[name, 4].pose.position.y for name in ("objects", "place_2", "classes")] == [1.0, -1.0, 1.0]
    assert [markers[name, 4].color.a for name in ("objects", "place_2")] == pytest.approx([0.42, 0.28])
    assert [(own.ns, own.id) for own in view.of(belief).markers if own.action == 2] == [("place_2", 4)]


def test_ellipsoid_spans_two_standard_deviations() -> None:
    """Variances 0.09 and 0.25 m^2 along x and y: diameters 4 x 0.3 m and 4 x 0.5 m; the flat axis has a least size."""
    belief = small_belief(0, [1], [1], [1.0], [4], [[4]])
    covariance = np.zeros((1, 6, 6))
    covariance[0, 0, 0], covariance[0, 1, 1] = 0.09, 0.25
    marker = MarkersView().of(replace(belief, object_covariances=covariance)).markers[0]
    assert sorted([marker.scale.x, marker.scale.y, marker.scale.z]) == pytest.approx([0.1, 1.2, 2.0])


def test_in_space_an_ellipsoid_has_three_axes_of_its_own_and_stands_at_its_height() -> None:
    belief = small_belief(0, [1], [1], [1.0], [4], [[4]])
    turn, sigmas = Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix(), np.array([0.2, 0.4, 0.7])
    covariance = np.zeros((1, 6, 6))
    covariance[0, :3, :3] = turn @ np.diag(sigmas**2) @ turn.T
    poses = np.array([[1.0, 2.0, 0.9, 0.0, 0.0, 0.0, 1.0]])
    marker = MarkersView().of(replace(belief, object_poses=poses, object_covariances=covariance)).markers[0]
    scale, pose = np.array([marker.scale.x, marker.scale.y, marker.scale.z]), marker.pose
    axes = Rotation.from_quat([getattr(pose.orientation, axis) for axis in "xyzw"]).as_matrix()
    np.testing.assert_allclose(axes @ np.diag((scale / 4.0) ** 2) @ axes.T, covariance[0, :3, :3], atol=1e-12)
    assert pose.position.z == 0.9


@pytest.mark.parametrize(("unexplained", "level"), [(np.nan, Level.WARN), (0.2, Level.OK), (0.9, Level.WARN)])
def test_a_belief_that_cannot_explain_its_data_or_does_not_know_is_a_warning(unexplained: float, level: Level) -> None:
    belief = replace(small_belief(3, [1], [0], [1.0], [1], [[0]]), unexplained=unexplained, log_evidence=-31.25)
    status = model_fit_status(belief)
    assert status.level == level and status.values["log_evidence"] == "-31.25"
    assert ("keyframe 3" in status.message) == (level == Level.WARN)
    assert ("not known" in status.message) == np.isnan(unexplained)
    carried = model_fit_status(belief, 0.98)
    assert carried.level == Level.WARN and "carried elsewhere lately (98%)" in carried.message
    assert model_fit_status(None).level == Level.OK


def test_a_topic_of_which_nothing_came_again_is_not_told() -> None:
    told = Counter({topics.COMMITS: 0})
    assert (repeated_status(told).message, repeated_status(told).values) == ("nothing came again", {})
    told[topics.KEYFRAMES] += 2
    assert repeated_status(told).message == f"2 x {topics.KEYFRAMES}"
