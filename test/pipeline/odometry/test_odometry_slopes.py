"""How the odometry's biases change the motion between keyframes, from the samples between them."""

from pathlib import Path

import numpy as np
from semantic_slam_lab.studies.victoria_park.data import Variant, make_drive
from worlds.bags.bag_factory import START

from semantic_slam.bag.reader import BagReader
from semantic_slam.configuration import from_dict
from semantic_slam.datasets.victoria_park import example_path, read_log
from semantic_slam.datasets.victoria_park_import import measurements, write_bag
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import pose_vector_from_planar
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.models.odometry_bias import composed_slopes, slopes
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message, to_message
from semantic_slam.messages.standard import OdometryEstimate
from semantic_slam.pipeline.assembly.keyframe_assembler import KeyframeAssembler

MS = 1_000_000
ESTIMATED = {"odometry": {"estimate_bias": True}}
STEPS = np.array([[0.3, 0.0, 0.2], [0.4, 0.1, -0.5], [0.2, -0.1, 0.9], [0.5, 0.0, 0.0], [0.1, 0.2, -2.0]])
"""Motions between odometry samples, together far from one arc."""


def keyframes_at(stamps_ms: list[int], configuration: dict[str, object]) -> list[Keyframe]:
    """Of a drive along STEPS from far away, a sample every 100 ms."""
    assembler = KeyframeAssembler(from_dict(configuration))
    pose = np.array([300.0, -200.0, 2.0])
    for index, step in enumerate([np.zeros(3), *STEPS]):
        pose = se2.compose(pose, step)
        sample = OdometryEstimate(
            START + 100 * MS * index, "odom", "base_link", pose_vector_from_planar(pose), np.eye(6)
        )
        assembler.add_odometry(to_message(sample))
    for number, stamp_ms in enumerate(stamps_ms):
        assembler.add_measurements(measurements(np.array([[1.0, 0.0]]), START + stamp_ms * MS, number, 0.1))
    return assembler.take()


def composed(steps: Array) -> Array:
    total = np.zeros((3, 3))
    for step in steps:
        total = composed_slopes(total, step, slopes(step))
    return total


def test_the_slopes_of_all_samples_between_two_keyframes_are_composed() -> None:
    first, second = keyframes_at([200, 500], ESTIMATED)
    np.testing.assert_allclose(first.odometry_slopes, composed(STEPS[:2]), atol=1e-10)
    np.testing.assert_allclose(second.odometry_slopes, composed(STEPS[2:]), atol=1e-10)


def test_a_keyframe_between_two_samples_cuts_their_step() -> None:
    first, second, third = keyframes_at([100, 150, 200], ESTIMATED)
    half = STEPS[1] / 2.0  # positions lie on the line, headings turn evenly
    rest = se2.between(half, STEPS[1])
    np.testing.assert_allclose(first.odometry_slopes, slopes(STEPS[0]), atol=1e-10)
    np.testing.assert_allclose(second.odometry_slopes, slopes(half), atol=1e-10)
    # An odometry sample's own step is one arc: what is left of it are the slopes of the whole, less those before.
    left = composed_slopes(slopes(half), rest, np.zeros((3, 3)))
    np.testing.assert_allclose(third.odometry_slopes, slopes(STEPS[1]) - left, atol=1e-10)


def test_without_estimated_biases_there_are_none() -> None:
    assert [keyframe.odometry_slopes for keyframe in keyframes_at([200, 500], {})] == [None, None]


def test_the_bag_of_victoria_park_gives_those_of_the_file(tmp_path: Path) -> None:
    log = read_log(example_path())
    write_bag(log, tmp_path / "bag", 0.4, max_keyframes=40)
    assembler = KeyframeAssembler(from_dict(ESTIMATED))
    with BagReader(tmp_path / "bag") as reader:
        for message in reader.messages([topics.ODOMETRY, topics.MEASUREMENTS]):
            content = reader.decode(message.cdr, message.type_name)
            if message.type_name == topics.TYPES[topics.ODOMETRY]:
                assembler.add_odometry(content)
            else:
                assembler.add_measurements(from_message(content))
    found, expected = assembler.flush(), make_drive(log, Variant(num_keyframes=40)).keyframes
    assert len(found) == len(expected) == 40
    for own, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(own.odometry_slopes, other.odometry_slopes, atol=1e-10)
