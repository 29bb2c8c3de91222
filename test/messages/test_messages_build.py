"""The colcon build: our messages as rclpy sees them are those of the typestore, and every executable is there."""

import json
import subprocess
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_share_directory
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.serde import SerdeError
from semantic_slam_msgs.msg import DetectionArray
from semantic_slam_msgs.msg import ReplayProgress as ReplayProgressMessage

from semantic_slam.errors import MessageError
from semantic_slam.messages.codec import decode, encode
from semantic_slam.messages.ground_truth import ReplayProgress
from semantic_slam.messages.typestore import DEFINITIONS, MOST_BEHIND, PACKAGE, deserialize, typestore

NAMES = sorted(path.stem for path in DEFINITIONS.glob("*.msg"))
NODES = ["bag_player", "bag_recorder", "backend_node", "classifier_node", "hypothesis_manager_node"]
COMMANDS = ["make_scene", "import_dataset", "bag_to_report", "train_classifier", "fit_viewpoint_models", "demo"]


@pytest.mark.parametrize("name", NAMES)
def test_type_hash_of_the_build_is_that_of_the_typestore(name: str) -> None:
    """The hash covers all fields, their types and order, also of nested messages (REP-2011)."""
    path = Path(get_package_share_directory(PACKAGE)) / "msg" / f"{name}.json"
    hashes = {row["type_name"]: row["hash_string"] for row in json.loads(path.read_text())["type_hashes"]}
    type_name = f"{PACKAGE}/msg/{name}"
    assert typestore().hash_rihs01(type_name) == hashes[type_name]


def test_rclpy_reads_what_the_codec_writes() -> None:
    progress = ReplayProgress(stamp_ns=1_500_000_000, frames=7, finished=True)
    message = deserialize_message(encode(progress), ReplayProgressMessage)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 500_000_000)
    assert (message.frames, message.finished) == (7, True)


def test_codec_reads_what_rclpy_writes() -> None:
    message = ReplayProgressMessage(frames=7, finished=True)
    message.header.stamp.nanosec = 5
    read = decode(serialize_message(message), f"{PACKAGE}/msg/ReplayProgress")
    assert read == ReplayProgress(stamp_ns=5, frames=7, finished=True)


def test_codec_reads_detections_behind_which_rclpy_leaves_what_it_had_reserved() -> None:
    """As bags have them that are written by rosbag2_py."""
    labels = ["chair", "cup"]
    written = serialize_message(DetectionArray(labels=labels, boxes=[0.0] * 8, scores=[0.5, 0.25]))
    type_name = f"{PACKAGE}/msg/DetectionArray"
    with pytest.raises(SerdeError):
        typestore().deserialize_cdr(written, type_name)  # what this is for
    assert list(deserialize(written, type_name).labels) == labels
    with pytest.raises(MessageError, match="message ends after"):
        deserialize(written + bytes(MOST_BEHIND), type_name)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("name", NODES + COMMANDS)
def test_executable_explains_itself(name: str) -> None:
    result = subprocess.run([name, "--help"], capture_output=True, text=True, timeout=120)
    assert (result.returncode, result.stderr) == (0, "")
    assert "usage:" in result.stdout


@pytest.mark.slow
def test_unknown_argument_is_refused_in_one_line() -> None:
    result = subprocess.run(["bag_player", "--bag", "x"], capture_output=True, text=True, timeout=120)
    assert (result.returncode, result.stderr.count("\n")) == (2, 1)
