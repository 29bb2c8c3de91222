"""Boxes, labels and scores of any detector in a user's own bag."""

import numpy as np
import pytest
from worlds.bags.imported import import_bag, read_bag, run_import
from worlds.bags.user_bag_factory import FOCAL, SECOND, write_drive

from semantic_slam.datasets.user_bag.detection_formats import axis_aligned_box
from semantic_slam.datasets.user_bag.label_map import read_label_map
from semantic_slam.errors import InputError
from semantic_slam.messages.typestore import message_class


@pytest.mark.parametrize("detector", ["vision_4", "vision_2", "yolo"])
def test_boxes_of_every_detector_are_read(tmp_path, monkeypatch, detector):
    source = write_drive(tmp_path / "source", detector=detector, track_ids=("5", ""))
    first = import_bag(monkeypatch, "bag", source, "--out", tmp_path / "bag")["/detections"][0]
    u = 80 + FOCAL * 0.5 / 3.0  # an object 0.5 m to the right and 3 m ahead
    assert first.stamp_ns == SECOND
    assert first.frame_id == "camera_optical_frame"
    assert first.labels == ("cup", "bottle")
    assert first.track_ids == ("5", "")
    np.testing.assert_allclose(first.boxes[0], [u - 12, 48, u + 12, 72])
    np.testing.assert_allclose(first.scores, [0.9, 0.9])


def test_a_turned_box_is_enclosed():
    center = message_class("geometry_msgs/msg/Pose2D")(x=50.0, y=40.0, theta=np.pi / 2)
    np.testing.assert_allclose(axis_aligned_box(center, 20.0, 10.0), [45, 30, 55, 50])


def test_labels_are_mapped_dropped_and_unknown_ones_named(tmp_path, monkeypatch, capsys):
    labels = tmp_path / "labels.yaml"
    labels.write_text("cup: mug\nperson: null\n")
    source = write_drive(tmp_path / "source", frames=3)
    run_import(monkeypatch, "bag", source, "--out", tmp_path / "bag", "--labels", labels)
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


def test_all_scores_are_read_and_every_message_names_all_classes(tmp_path, monkeypatch):
    """The detector reports "unlikely" with a third of the score; another label is never reported."""
    source = write_drive(tmp_path / "source", detector="vision_4")
    for found in import_bag(monkeypatch, "bag", source, "--out", tmp_path / "bag")["/detections"]:
        assert found.class_names == ("bottle", "cup", "unlikely")
        np.testing.assert_allclose(found.class_scores, [[np.nan, 0.9, 0.3], [0.9, np.nan, 0.3]])


def test_a_detector_without_further_hypotheses_names_its_labels(tmp_path, monkeypatch):
    source = write_drive(tmp_path / "source", detector="yolo")
    (first, *_) = import_bag(monkeypatch, "bag", source, "--out", tmp_path / "bag")["/detections"]
    assert first.class_names == ("bottle", "cup")
    assert np.isnan(first.class_scores).all()


def test_scores_are_renamed_with_the_labels(tmp_path, monkeypatch):
    """What is called the same adds up; what is dropped has no score."""
    labels = tmp_path / "labels.yaml"
    labels.write_text("cup: mug\nbottle: vessel\nunlikely: mug\n")
    source = write_drive(tmp_path / "source", detector="vision_4")
    run_import(monkeypatch, "bag", source, "--out", tmp_path / "bag", "--labels", labels)
    first = read_bag(tmp_path / "bag")["/detections"][0]
    assert first.labels == ("mug", "vessel") and first.class_names == ("mug", "vessel")
    np.testing.assert_allclose(first.class_scores, [[1.2, np.nan], [0.3, 0.9]])
