"""Conversion between this package's dataclasses, ROS messages and CDR bytes.

A new message is one entry of ``CODECS``. Shapes are checked in both directions: a wrong shape in a received message is
a MessageError that names the field, a wrong shape in one of our own objects a ValueError.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from semantic_slam.errors import InputError
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import Candidates, Commit, Components, MissedKeyframes, RunConfiguration
from semantic_slam.messages import belief, ground_truth, measurements, rounds, standard
from semantic_slam.messages.layout import Layout
from semantic_slam.messages.typestore import deserialize, serialize
from semantic_slam.perception.frame import Detections
from semantic_slam.perception.measurement import SemanticMeasurements


@dataclass(frozen=True)
class Codec:
    """Conversion functions and layout of one dataclass."""

    type_name: str
    to_message: Callable[..., Any]
    from_message: Callable[[Any], Any]
    layout: Layout = field(default_factory=dict)  # shapes of the message's arrays


CODECS: dict[type, Codec] = {
    Detections: Codec(
        measurements.DETECTIONS_TYPE,
        measurements.detections_to_message,
        measurements.detections_from_message,
        measurements.DETECTIONS_LAYOUT,
    ),
    SemanticMeasurements: Codec(
        measurements.MEASUREMENTS_TYPE,
        measurements.measurements_to_message,
        measurements.measurements_from_message,
        measurements.MEASUREMENTS_LAYOUT,
    ),
    HybridBelief: Codec(belief.BELIEF_TYPE, belief.belief_to_message, belief.belief_from_message, belief.BELIEF_LAYOUT),
    RunConfiguration: Codec(rounds.RUN_TYPE, rounds.run_to_message, rounds.run_from_message, rounds.RUN_LAYOUT),
    Keyframe: Codec(
        rounds.KEYFRAME_TYPE, rounds.keyframe_to_message, rounds.keyframe_from_message, rounds.KEYFRAME_LAYOUT
    ),
    Candidates: Codec(
        rounds.CANDIDATES_TYPE, rounds.candidates_to_message, rounds.candidates_from_message, rounds.CANDIDATES_LAYOUT
    ),
    Commit: Codec(rounds.COMMIT_TYPE, rounds.commit_to_message, rounds.commit_from_message, rounds.COMMIT_LAYOUT),
    Components: Codec(
        rounds.COMPONENTS_TYPE, rounds.components_to_message, rounds.components_from_message, rounds.COMPONENTS_LAYOUT
    ),
    MissedKeyframes: Codec(rounds.MISSED_TYPE, rounds.missed_to_message, rounds.missed_from_message),
    ground_truth.GroundTruthObjects: Codec(
        ground_truth.OBJECTS_TYPE,
        ground_truth.objects_to_message,
        ground_truth.objects_from_message,
        ground_truth.OBJECTS_LAYOUT,
    ),
    ground_truth.GroundTruthAssociations: Codec(
        ground_truth.ASSOCIATIONS_TYPE,
        ground_truth.associations_to_message,
        ground_truth.associations_from_message,
        ground_truth.ASSOCIATIONS_LAYOUT,
    ),
    ground_truth.ReplayProgress: Codec(
        ground_truth.PROGRESS_TYPE, ground_truth.progress_to_message, ground_truth.progress_from_message
    ),
    standard.PoseEstimate: Codec(
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        standard.pose_estimate_to_message,
        standard.pose_estimate_from_message,
    ),
    standard.OdometryEstimate: Codec(
        "nav_msgs/msg/Odometry", standard.odometry_to_message, standard.odometry_from_message
    ),
}
BY_TYPE_NAME = {codec.type_name: codec for codec in CODECS.values()}


def to_message(value: Any, **context: Any) -> Any:
    """Convert one of our dataclasses to its message; a Keyframe also needs ``run_id=``."""
    return CODECS[type(value)].to_message(value, **context)


def from_message(message: Any) -> Any:
    """Convert a message to its dataclass. Raises MessageError when its arrays contradict each other."""
    return _codec(message.__msgtype__).from_message(message)


def encode(value: Any, **context: Any) -> bytes:
    """CDR bytes of one of our dataclasses, as sent by publishers and stored in bags."""
    return serialize(to_message(value, **context))


def decode(data: bytes, type_name: str) -> Any:
    """Dataclass from the CDR bytes of a message of that type. Raises InputError."""
    return _codec(type_name).from_message(deserialize(data, type_name))


def is_usable(data: bytes, type_name: str) -> bool:
    """Whether CDR bytes decode to a valid message of that type."""
    try:
        decode(data, type_name)
    except InputError:
        return False
    return True


def _codec(type_name: str) -> Codec:
    if type_name not in BY_TYPE_NAME:
        raise InputError(f"{type_name}: no such type is used here; known are {', '.join(sorted(BY_TYPE_NAME))}")
    return BY_TYPE_NAME[type_name]
