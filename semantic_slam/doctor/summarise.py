"""Single pass over an input's messages: all stamps and detections, and samples of everything else."""

import struct
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from semantic_slam.bag.mcap_stream import RawMessage
from semantic_slam.doctor.front_end import FrontEnd
from semantic_slam.doctor.input_summary import (
    DISPARITIES,
    LARGEST_OVERLAP,
    DetectionRecord,
    ImuRecord,
    InputSummary,
    PictureRecord,
    Stamps,
)
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_pose_vector
from semantic_slam.messages.codec import from_message
from semantic_slam.messages.disparity import is_disparity
from semantic_slam.messages.images import decode_depth, size_of
from semantic_slam.messages.inertial import imu_reading, shown_acceleration
from semantic_slam.messages.sensor import plain_frame
from semantic_slam.messages.standard import NANOSECONDS, header_stamp_ns, is_pose, pose_vector
from semantic_slam.perception.boxes.same_outline import overlaps
from semantic_slam.perception.frame import Detections
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.pipeline.detector_labels import labels_of
from semantic_slam.pipeline.gravity.imu_use import unused_because

MOST_PICTURES = 5
MOST_ODOMETRY = 1000
MOST_DETECTIONS = 3000
"""Messages that are decoded at most, besides those of the front end."""
LITTLE, BIG = struct.Struct("<iI"), struct.Struct(">iI")
"""How a header's stamp begins a message, behind the four bytes of its encoding."""
ENCODING = 4


@dataclass
class _Rows:
    """What is gathered of the detections."""

    record: DetectionRecord = field(default_factory=DetectionRecord)
    boxes: list[Any] = field(default_factory=list)
    scores: list[Any] = field(default_factory=list)

    def add(self, told: Detections | SemanticMeasurements) -> None:
        record = self.record
        record.num_messages += 1
        record.frame_ids[plain_frame(told.frame_id)] += 1
        record.labels.update(told.labels)
        record.told_labels |= labels_of(told)
        record.frames_of_boxes[plain_frame(told.frame_id)] += bool(np.isfinite(told.boxes).any())
        record.num_doubled += _are_doubled(told)
        record.has_embeddings |= told.embeddings.shape[1] > 0
        self.boxes.append(told.boxes.reshape(-1, 4))
        self.scores.append(told.scores)

    def finished(self) -> DetectionRecord:
        if self.boxes:
            self.record.boxes, self.record.scores = np.concatenate(self.boxes), np.concatenate(self.scores)
        return self.record


class Summariser:
    """Fills an :class:`InputSummary`, message by message."""

    def __init__(self, summary: InputSummary, decode: Callable[[bytes, str], Any]) -> None:
        """``decode`` raises InputError."""
        self._summary, self._decode = summary, decode
        found = summary.found
        heard = found if summary.counts.get(found.imu, 0) else replace(found, imu="")  # silence has a check of its own
        self._front = FrontEnd(summary.configuration, heard, summary.preamble)
        self._stamped = {*wanted_topics(summary)} - {found.transforms}
        self._times: dict[str, list[tuple[int, int]]] = {topic: [] for topic in self._stamped}
        self._rows = _Rows()
        self._odometry: list[Array] = []
        self._num_measured = 0

    def take(self, messages: Iterable[RawMessage]) -> None:
        """All messages of an input, in the order in which they came; what ends them early raises InputError."""
        try:
            for message in messages:
                self._take(message)
        finally:
            self._finish()

    def _take(self, message: RawMessage) -> None:
        if message.topic in self._stamped and len(message.cdr) >= ENCODING + LITTLE.size:
            self._times[message.topic].append((serialised_stamp_ns(message.cdr), message.stamp_ns))
        if message.topic in (self._summary.found.image, self._summary.found.depth):
            self._summary.picture_bytes[message.topic] = len(message.cdr)
        if not self._is_looked_at(message.topic):
            return
        try:
            content = self._decode(message.cdr, message.type_name)
        except InputError as fault:
            self._summary.dropped[f"{message.topic}: message does not decode"] += 1
            if str(fault) not in self._summary.faults:
                self._summary.faults.append(str(fault))
            return
        self._look(message.topic, content)
        if not self._front.is_done:
            self._front.take(message.topic, content)

    def _is_looked_at(self, topic: str) -> bool:
        """Whether more than its stamp is of interest."""
        summary = self._summary
        if not self._front.is_done:
            return True
        if topic == summary.found.odometry:
            return summary.odometry_frames.total() < MOST_ODOMETRY
        return topic == summary.measured and self._num_measured < MOST_DETECTIONS

    def _look(self, topic: str, content: Any) -> None:
        summary, found = self._summary, self._summary.found
        if topic == found.odometry:
            frames = plain_frame(content.header.frame_id), plain_frame(content.child_frame_id)
            summary.odometry_frames[frames] += 1
            pose = pose_vector(content.pose.pose)
            if is_pose(pose):
                x, y, yaw = planar_from_pose_vector(pose)
                self._odometry.append(np.array([header_stamp_ns(content) / NANOSECONDS, x, y, yaw]))
        elif topic == summary.measured:
            self._num_measured += 1
            with suppress(InputError):  # which the front end counts
                self._rows.add(from_message(content))
        elif topic == found.imu:
            _look_at_imu(summary.imu, content)
        elif topic == found.image:
            _look_at_picture(summary.images, content)
        elif topic == found.depth:
            _look_at_depth(summary.depths, content)

    def _finish(self) -> None:
        summary, front = self._summary, self._front
        front.finish()
        for topic, times in self._times.items():
            header, arrival = np.array(times, dtype=np.int64).reshape(-1, 2).T
            summary.stamps[topic] = Stamps(header, arrival)
        summary.detections = self._rows.finished()
        summary.camera, summary.camera_poses = front.camera, front.camera_poses
        summary.num_frames, summary.keyframes = front.num_frames, front.keyframes
        summary.odometry = np.array(self._odometry).reshape(-1, 4)
        summary.dropped += front.dropped
        summary.faults += front.faults


def wanted_topics(summary: InputSummary) -> list[str]:
    """Topics of an input that a run reads."""
    found = summary.found
    identities = found.identities if not summary.found.measurements else ""
    imu = "" if unused_because(summary.configuration) else found.imu
    names = (found.odometry, summary.measured, found.image, found.camera_info, found.depth, identities, imu)
    return [topic for topic in (*names, found.transforms) if topic]


def serialised_stamp_ns(cdr: bytes) -> int:
    """Stamp of a serialised message that begins with a header."""
    seconds, nanoseconds = (LITTLE if cdr[1] else BIG).unpack_from(cdr, ENCODING)
    return int(seconds) * NANOSECONDS + int(nanoseconds)


def _are_doubled(told: Detections | SemanticMeasurements) -> bool:
    """Whether two boxes of one label overlap by more than ``LARGEST_OVERLAP``."""
    boxes, labels = told.boxes.reshape(-1, 4), np.array(told.labels)
    alike = (overlaps(boxes, boxes) > LARGEST_OVERLAP) & (labels[:, None] == labels[None, :])
    return bool(np.triu(alike, 1).any())


def _look_at_imu(record: ImuRecord, message: Any) -> None:
    reading, acceleration = imu_reading(message), shown_acceleration(message)
    record.frame_id = reading.frame_id
    record.num_messages += 1
    if reading.up is not None:
        record.ups.append(reading.up)
    if acceleration is not None:
        record.accelerations.append(acceleration)


def _look_at_picture(record: PictureRecord, message: Any) -> bool:
    """Note what a picture is like; whether more of them are looked at."""
    if record.encodings.total() >= MOST_PICTURES:
        return False
    encoding = DISPARITIES if is_disparity(message) else getattr(message, "encoding", "")
    record.encodings[encoding or getattr(message, "format", "")] += 1
    size = size_of(message)
    if size is not None:
        record.sizes[size] += 1
    return True


def _look_at_depth(record: PictureRecord, message: Any) -> None:
    if not _look_at_picture(record, message):
        return
    try:
        depth_m = decode_depth(message, "depth")
    except InputError:
        return  # the front end counts it
    known = depth_m[np.isfinite(depth_m)]
    if known.size:
        record.medians_m.append(float(np.median(known)))
