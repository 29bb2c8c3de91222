"""The map as messages of vision_msgs, through their own serialisation."""

from dataclasses import replace

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from worlds.bags.user_bag_factory import VISION_3D
from worlds.belief_factory import CLASSES, small_belief

from semantic_slam.ros.publishing.detections_view import NO_CLASS, DetectionsView

LABELS = {
    "LabelInfo": "std_msgs/Header header\nvision_msgs/VisionClass[] class_map\nfloat32 threshold",
    "VisionClass": "uint16 class_id\nstring class_name",
}


@pytest.fixture(scope="module")
def store():
    store, types = get_typestore(Stores.ROS2_JAZZY), {}
    for name, text in (VISION_3D | LABELS).items():
        types |= get_types_from_msg(text, f"vision_msgs/msg/{name}")
    store.register(types)
    return store


@pytest.fixture
def belief():
    return small_belief(3, [1, 2], [1, 1], [0.75, 0.25], [4, 9], [[4], [9]])


def told(store, message):
    """What a reader gets of the bytes."""
    kind = message.__msgtype__
    return store.deserialize_cdr(store.serialize_cdr(message, kind), kind)


def test_each_object_has_its_whole_distribution_and_the_covariance_over_all_hypotheses(store, belief):
    belief = replace(belief, existence=np.array([0.5, np.nan]))
    message = told(store, DetectionsView(store.types.__getitem__, "robot1/map").objects(belief))
    assert message.header.frame_id == "robot1/map" and [own.id for own in message.detections] == ["4", "9"]
    for row, own in enumerate(message.detections):
        names = [result.hypothesis.class_id for result in own.results]
        scores = np.array([result.hypothesis.score for result in own.results])
        assert names == list(CLASSES)
        np.testing.assert_allclose(scores, belief.class_probabilities[row] * (0.5, 1.0)[row])
        for result in own.results:
            np.testing.assert_array_equal(result.pose.covariance, belief.object_covariances[row].ravel())
            assert result.pose.pose.position.x == belief.object_poses[row, 0] == own.bbox.center.position.x


def test_an_object_without_a_place_is_left_out_and_one_without_classes_is_an_object(store, belief):
    poses = belief.object_poses.copy()
    poses[0] = np.nan
    plain = replace(belief, object_poses=poses, class_names=(), class_probabilities=np.zeros((2, 0)))
    (own,) = told(store, DetectionsView(store.types.__getitem__).objects(plain)).detections
    assert own.id == "9" and [result.hypothesis.class_id for result in own.results] == [NO_CLASS]


def test_label_info_numbers_the_classes_of_the_belief(store, belief):
    message = told(store, DetectionsView(store.types.__getitem__).label_info(belief))
    assert {entry.class_id: entry.class_name for entry in message.class_map} == dict(enumerate(CLASSES))
