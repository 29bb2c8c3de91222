"""Keyframes of a live run wait for the first label, and begin the run that they would have begun."""

from dataclasses import replace

import numpy as np
import pytest
from worlds.bags.bag_factory import SPEED_M, frame_stamp, input_entries, of_topic
from worlds.scenes.planar_world import make_world

from semantic_slam.configuration import SemanticModelConfiguration, from_dict
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.messages import topics
from semantic_slam.pipeline import first_label
from semantic_slam.pipeline.assembly.keyframe_assembler import KeyframeAssembler
from semantic_slam.pipeline.first_label import FirstLabel

DETECTOR = SemanticModelConfiguration(kind="detector")


def said(keyframe: Keyframe, *labels: str, class_names: tuple[str, ...] = ()) -> Keyframe:
    """The keyframe with as many detections as labels."""
    measured = keyframe.measurements.take(np.arange(len(labels)))
    samples = np.zeros((len(labels), 0, len(class_names)))
    told = replace(measured, labels=labels, class_names=class_names, class_probability_samples=samples)
    return replace(keyframe, measurements=told)


@pytest.fixture(scope="module")
def drive() -> list[Keyframe]:
    return make_world(4).keyframes


def test_keyframes_that_name_nothing_wait_for_the_one_that_does(drive: list[Keyframe]) -> None:
    word = FirstLabel(DETECTOR)
    silent, telling = [said(keyframe) for keyframe in drive[:2]], said(drive[2], "cup", "chair")
    assert word.released(silent[:1]) == word.released(silent[1:]) == []
    assert word.num_waiting == 2
    assert word.released([telling]) == [*silent, telling]
    assert word.labels == {"cup", "chair"} and not word.num_waiting
    last = said(drive[3])
    assert word.released([last]) == [last]


def test_classes_that_a_detector_scores_are_named_without_a_detection(drive: list[Keyframe]) -> None:
    word = FirstLabel(DETECTOR)
    assert word.released([said(drive[0], class_names=("chair", "tv"))])
    assert word.labels == {"chair", "tv"}


def test_at_the_end_and_without_a_label_nothing_waits(drive: list[Keyframe]) -> None:
    """Who reads the first detection says what is missing."""
    word = FirstLabel(DETECTOR)
    assert word.released([said(drive[0])]) == []
    assert len(word.released([said(drive[1], "")])) == 2
    ended = FirstLabel(DETECTOR)
    assert ended.released([said(drive[0])]) == [] and len(ended.released([], at_end=True)) == 1


@pytest.mark.parametrize(
    "settings", [SemanticModelConfiguration(kind="gp_independent"), replace(DETECTOR, labels=("chair",))]
)
def test_where_the_classes_are_known_nothing_waits(settings: SemanticModelConfiguration, drive: list[Keyframe]) -> None:
    word = FirstLabel(settings)
    assert len(word.released([said(drive[0])])) == 1


def test_of_keyframes_too_many_the_motion_is_kept(drive: list[Keyframe], monkeypatch: pytest.MonkeyPatch) -> None:
    """Of six frames two wait, two are passed over and counted; the third keyframe moves as far as three frames."""
    monkeypatch.setattr(first_label, "MOST_WAITING", 2)
    word = FirstLabel(DETECTOR)
    configuration = from_dict({"association": "open", "semantic_model": {"kind": "detector"}})
    assembler = KeyframeAssembler(configuration, passes_over=word.passes_over)
    found = []
    for entry in of_topic(input_entries(7), topics.ODOMETRY):
        assembler.add_odometry(entry.message)
    for k in range(6):
        measured = said(drive[0], *(["cup"] if k >= 4 else [])).measurements
        assembler.add_measurements(replace(measured, stamp_ns=frame_stamp(k)))
        found += word.released(assembler.take())
    assert [keyframe.index for keyframe in found] == [0, 1, 2, 3]
    moved = np.array([keyframe.odometry[0] for keyframe in found])
    np.testing.assert_allclose(moved, SPEED_M * np.array([1, 1, 3, 1]), atol=1e-9)
    assert sum(assembler.dropped.values()) == 2
