"""The bag of somebody else: the room's pictures and odometry, with the boxes of a detector as vision_msgs has them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from semantic_slam.bag.reader import BagReader
from semantic_slam.bag.writer import BagWriter
from semantic_slam.evaluation.trajectory import Trajectory, interpolate
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_pose_vector
from semantic_slam.messages.codec import from_message
from semantic_slam.messages.ground_truth import GroundTruthAssociations, GroundTruthObjects
from semantic_slam.perception.frame import Detections
from semantic_slam_lab.simulation.detectors.detector_boxes import Box, torn
from semantic_slam_lab.simulation.detectors.detector_words import (
    NAMES,
    DetectorFaults,
    Hypotheses,
    Seen,
    alarm,
    hypotheses,
    other_hypotheses,
)

DEFINITIONS = {
    "Detection2DArray": "std_msgs/Header header\nvision_msgs/Detection2D[] detections",
    "Detection2D": "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
    "vision_msgs/BoundingBox2D bbox\nstring id",
    "ObjectHypothesisWithPose": "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose",
    "ObjectHypothesis": "string class_id\nfloat64 score",
    "BoundingBox2D": "vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y",
    "Pose2D": "vision_msgs/Point2D position\nfloat64 theta",
    "Point2D": "float64 x\nfloat64 y",
}
TYPE = "vision_msgs/msg/Detection2DArray"
TOPIC = "/detector/detections"
REPLACED = ("/detections", "/ground_truth/associations", "/ground_truth/objects")
LEFT_OUT = ("/initialpose",)
ALARM_WIDTH, ALARM_HEIGHT = (0.08, 0.25), (0.1, 0.3)
"""Shares of the picture that boxes of false alarms take, evenly."""


@dataclass(frozen=True, kw_only=True)
class _Room:
    """What the drawn detector has to know of the room."""

    detections: dict[int, Detections]  # by stamp
    associations: dict[int, tuple[str, ...]]
    objects: GroundTruthObjects
    trajectory: Trajectory
    size: tuple[int, int]  # of the picture: width, height

    def seen(self, stamp_ns: int, object_id: str) -> Seen:
        """The object as the camera looks at it then; the camera stands where the robot does."""
        number = self.objects.object_ids.index(object_id)
        pose = planar_from_pose_vector(self.objects.poses[number])
        robot = planar_from_pose_vector(interpolate(self.trajectory, np.array([stamp_ns], dtype=np.int64))[0])
        azimuth = float(np.arctan2(*(robot - pose)[1::-1]) - pose[2])
        name = self.objects.class_names[number]
        return Seen(name=NAMES.get(name, name), number=number, azimuth_rad=azimuth)


def write_detector_bag(
    room: Path, out: Path, faults: DetectorFaults, seed: int | Sequence[int], detector: int = 0
) -> None:
    """Write ``out`` from the bag ``room``; what is true is told under /ground_truth, with the detector's names.

    ``seed`` keys everything that is drawn but what the detector confuses by side or view, for which ``detector`` is.
    """
    random = np.random.default_rng(seed)
    with BagReader(room) as reader:
        known = _read(reader)
        with BagWriter(out) as writer:
            objects = known.objects
            names = tuple(NAMES.get(name, name) for name in objects.class_names)
            first_ns = min(known.detections)
            renamed = GroundTruthObjects(objects.stamp_ns, objects.object_ids, names, objects.poses)
            writer.write("/ground_truth/objects", renamed, first_ns)
            for message in reader.messages():
                if message.topic == REPLACED[0]:
                    told = reader.decode(message.cdr, message.type_name)
                    _write_boxes(writer, known, message.stamp_ns, told, faults, random, detector)
                elif message.topic not in (*REPLACED, *LEFT_OUT):
                    writer.write_raw(message.topic, message.type_name, message.cdr, message.stamp_ns)


def _write_boxes(
    writer: BagWriter,
    room: _Room,
    log_ns: int,
    message: Any,
    faults: DetectorFaults,
    random: np.random.Generator,
    detector: int,
) -> None:
    """The boxes of one frame, and what they are of."""
    detections: Detections = from_message(message)
    stamp_ns = detections.stamp_ns
    true_ids = room.associations.get(stamp_ns, ("",) * len(detections))
    seen = [
        Box(edges=box, object_id=object_id)
        for box, object_id in zip(detections.boxes, true_ids, strict=True)
        if random.random() >= faults.dropped
    ]
    drawn = torn(seen, faults.boxes, room.size[0], random)
    boxes, of = [own.edges for own in drawn], [own.object_id for own in drawn]
    called = [_called(room.seen(stamp_ns, own.object_id), own, faults, random, detector) for own in drawn]
    for _ in range(random.poisson(faults.alarms_per_frame)):
        boxes.append(_alarm_box(room.size, random))
        called.append(alarm(faults, random))
        of.append("")
    raw = _serialized(stamp_ns, detections.frame_id, boxes, called)
    writer.write_raw(TOPIC, TYPE, raw, log_ns, _definition())
    writer.write("/ground_truth/associations", GroundTruthAssociations(stamp_ns, tuple(of)), log_ns)


def _called(seen: Seen, box: Box, faults: DetectorFaults, random: np.random.Generator, detector: int) -> Hypotheses:
    return other_hypotheses(seen, faults, random) if box.is_second else hypotheses(seen, faults, random, detector)


def _alarm_box(size: tuple[int, int], random: np.random.Generator) -> Array:
    width, height = (share * random.uniform(*of) for share, of in zip(size, (ALARM_WIDTH, ALARM_HEIGHT), strict=True))
    left, top = random.uniform(0.0, size[0] - width), random.uniform(0.3, 0.6) * size[1]
    return np.array([left, top, left + width, top + height])


def _read(reader: BagReader) -> _Room:
    detections, associations, objects, stamps, poses, size = {}, {}, None, [], [], (0, 0)
    wanted = [
        "/detections",
        "/ground_truth/associations",
        "/ground_truth/objects",
        "/ground_truth/odom",
        "/camera_info",
    ]
    for message in reader.messages(wanted):
        content = reader.decode(message.cdr, message.type_name)
        if message.topic == "/camera_info":
            size = int(content.width), int(content.height)
            continue
        value = from_message(content)
        if message.topic == "/detections":
            detections[value.stamp_ns] = value
        elif message.topic == "/ground_truth/associations":
            associations[value.stamp_ns] = value.object_id if hasattr(value, "object_id") else value.object_ids
        elif message.topic == "/ground_truth/objects":
            objects = value
        else:
            stamps.append(value.stamp_ns)
            poses.append(value.pose)
    assert objects is not None
    trajectory = Trajectory(np.array(stamps, dtype=np.int64), np.array(poses))
    return _Room(detections=detections, associations=associations, objects=objects, trajectory=trajectory, size=size)


@cache
def _store() -> Any:
    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for name, text in DEFINITIONS.items():
        types |= get_types_from_msg(text, f"vision_msgs/msg/{name}")
    store.register(types)
    return store


@cache
def _definition() -> str:
    return str(_store().generate_msgdef(TYPE, ros_version=2)[0])


def _make(type_name: str, **fields: Any) -> Any:
    return _store().types[type_name](**fields)


def _serialized(stamp_ns: int, frame_id: str, boxes: list[Array], called: list[Hypotheses]) -> bytes:
    time = _make("builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    header = _make("std_msgs/msg/Header", stamp=time, frame_id=frame_id)
    rows = [_row(header, box, own) for box, own in zip(boxes, called, strict=True)]
    message = _make(TYPE, header=header, detections=rows)
    return bytes(_store().serialize_cdr(message, TYPE))


def _row(header: Any, box: Array, called: Hypotheses) -> Any:
    x_min, y_min, x_max, y_max = map(float, box)
    middle = _make("vision_msgs/msg/Point2D", x=(x_min + x_max) / 2.0, y=(y_min + y_max) / 2.0)
    center = _make("vision_msgs/msg/Pose2D", position=middle, theta=0.0)
    bounds = _make("vision_msgs/msg/BoundingBox2D", center=center, size_x=x_max - x_min, size_y=y_max - y_min)
    results = [_result(name, score) for name, score in zip(called.names, called.scores, strict=True)]
    return _make("vision_msgs/msg/Detection2D", header=header, results=results, bbox=bounds, id="")


def _result(name: str, score: float) -> Any:
    point = _make("geometry_msgs/msg/Point", x=0.0, y=0.0, z=0.0)
    turn = _make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
    pose = _make("geometry_msgs/msg/Pose", position=point, orientation=turn)
    hypothesis = _make("vision_msgs/msg/ObjectHypothesis", class_id=name, score=float(score))
    covariance = _make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36))
    return _make("vision_msgs/msg/ObjectHypothesisWithPose", hypothesis=hypothesis, pose=covariance)
