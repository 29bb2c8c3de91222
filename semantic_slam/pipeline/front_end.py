"""All before inference: passes each message of a bag to the part that needs it, up to keyframes.

bag -> FrameAssembler -> Classifier -> KeyframeAssembler; without images PlacesAssembler takes the place of the first
two.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from semantic_slam.bag.mcap_stream import RawMessage
from semantic_slam.bag.reader import BagReader
from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError, MessageError
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.association.strategy import strategy_of
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.messages import topics
from semantic_slam.messages.codec import CODECS, encode, from_message
from semantic_slam.messages.sensor import sensor_pose
from semantic_slam.perception.frame import Frame
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.pipeline.assembly.frame_assembler import FrameAssembler
from semantic_slam.pipeline.assembly.keyframe_assembler import KeyframeAssembler
from semantic_slam.pipeline.assembly.places_assembler import PlacesAssembler
from semantic_slam.pipeline.build_classifier import build_classifier
from semantic_slam.pipeline.gravity.gravity_by_imu import ImuSource
from semantic_slam.pipeline.gravity.imu_use import NAME as IMU
from semantic_slam.pipeline.gravity.imu_use import unused_because
from semantic_slam.pipeline.input_topics import COPIED, InputTopics
from semantic_slam.pipeline.preamble import Preamble


class Reading(NamedTuple):
    """What became of a bag that was read."""

    dropped_by: dict[str, Counter[str]]  # counts of inputs not used, by part and reason
    last_stamp_ns: int  # of the newest message
    fault: InputError | None  # why reading ended early, if it did


@dataclass(frozen=True)
class ReadingOrder:
    """What to read of a bag, and how."""

    bag: Path
    configuration: Configuration
    found: InputTopics
    preamble: Preamble
    max_keyframes: int | None


class Receiver(Protocol):
    """Recipient of what a front end makes of a bag, in the order of the bag."""

    def copy(self, message: RawMessage) -> None:
        """Take a message of which the belief bag has a copy."""

    def measured(self, message: RawMessage) -> None:
        """Take the measurements of a frame, as they are recorded."""

    def keyframe(self, keyframe: Keyframe) -> None:
        """Take a keyframe, which is to be inferred. Raises InputError if the run cannot go on."""

    def say(self, line: str) -> None:
        """Take a line for the console."""


class FrontEnd:
    """Makes measurements and keyframes of a bag's messages, for a receiver.

    To construct one takes seconds where it loads a network.
    """

    def __init__(self, order: ReadingOrder, reader: BagReader) -> None:
        configuration, found, preamble = order.configuration, order.found, order.preamble
        self._perception, self._found, self._preamble = configuration.perception, found, preamble
        self._bag, self._reader, self._max_keyframes = order.bag, reader, order.max_keyframes
        self._receiver: Receiver
        self._num_frames, self._num_keyframes = 0, 0
        self._frames = FrameAssembler(
            configuration,
            has_depth=bool(found.depth),
            fixed_transforms=preamble.transforms if found.transforms else None,
        )
        is_imu_used = not unused_because(configuration) and reader.counts[found.imu] > 0
        self._imu = found.imu if is_imu_used else ""
        self._keyframes = KeyframeAssembler(
            configuration,
            has_identities=bool(found.identities),
            imu=ImuSource(preamble.transforms) if self._imu else None,
        )
        self._copied = {*COPIED} if self._imu else {*COPIED} - {IMU}
        self._classifier = build_classifier(configuration) if found.has_images else None
        self._places = PlacesAssembler(configuration, self._camera_pose, preamble.transforms)
        self._camera_poses: dict[str, Array] = {}
        self._undecodable: Counter[str] = Counter()
        self._last_stamp_ns = 0
        self._fault: InputError | None = None
        self._handlers = self._make_handlers(configuration)

    def _make_handlers(self, configuration: Configuration) -> dict[str, Callable[[Any], None]]:
        found = self._found
        handlers: dict[str, Callable[[Any], None]] = {found.odometry: self._keyframes.add_odometry}
        if self._imu:
            handlers[self._imu] = self._keyframes.add_imu
        if found.has_images:
            handlers |= {
                found.image: self._frames.add_image,
                found.camera_info: self._frames.add_camera_info,
                found.detections: self._frames.add_detections,
            }
            if found.transforms:
                handlers[found.transforms] = self._frames.add_transforms
            if found.depth:
                handlers[found.depth] = self._frames.add_depth
        elif not found.has_places_alone:
            handlers[found.measurements] = lambda message: self._add_measurements(from_message(message))
        else:
            handlers[found.detections] = self._places.add_detections
            if found.camera_info:
                handlers[found.camera_info] = self._places.add_camera_info
        if found.identities and strategy_of(configuration).wants_identities:
            handlers[found.identities] = lambda message: self._keyframes.add_identities(from_message(message))
        return handlers

    @property
    def is_done(self) -> bool:
        """Whether there are as many keyframes as asked for."""
        return self._max_keyframes is not None and self._num_keyframes >= self._max_keyframes

    def read(self, receiver: Receiver, check_interrupts: Callable[[], None]) -> None:
        """Read the bag up to its end, its damage, the last keyframe, or what ``check_interrupts`` raises."""
        self._receiver = receiver
        try:
            for message in self._reader.messages({*self._handlers, *self._copied}):
                check_interrupts()
                self._take(message)
                if self.is_done:
                    break
        except InputError as error:
            self._fault = error
        try:
            self._finish()
        except InputError as error:
            self._fault = self._fault or error

    @property
    def reading(self) -> Reading:
        """What became of the bag so far."""
        dropped = {
            "bag": self._undecodable,
            "frames": self._frames.dropped,
            "places": self._places.dropped,
            "classifier": self._classifier.dropped if self._classifier else Counter[str](),
            "keyframes": self._keyframes.dropped,
        }
        return Reading(dropped, self._last_stamp_ns, self._fault)

    def _take(self, message: RawMessage) -> None:
        """Process one message of the bag. Raises InputError if the run cannot continue."""
        self._last_stamp_ns = message.stamp_ns
        if message.topic in self._copied:
            self._receiver.copy(message)
        if message.topic not in self._handlers:
            return
        try:
            content = self._reader.decode(message.cdr, message.type_name)
        except InputError:
            self._undecodable[f"{message.topic}: message does not decode"] += 1
            return
        try:
            self._handlers[message.topic](content)
        except MessageError as fault:
            self._undecodable[f"{message.topic}: {fault.kind}"] += 1
            return
        self._measure(self._frames.take())
        self._pass_on(self._places.take())
        self._infer(self._keyframes.take())
        self._tell()

    def _finish(self) -> None:
        """Process everything that still waits for later messages. Raises InputError."""
        self._measure(self._frames.flush())
        self._pass_on(self._places.flush())
        self._infer(self._keyframes.flush())
        self._tell()

    def _tell(self) -> None:
        for line in self._keyframes.news():
            self._receiver.say(f"{self._bag}: {line}")

    def _measure(self, frames: list[Frame]) -> None:
        for frame in frames:
            if self._classifier is None or self.is_done:
                return
            T_base_camera = frame.T_base_camera
            if T_base_camera is None:
                T_base_camera = self._camera_pose(frame.camera.frame_id)
            measured = self._classifier.measure(frame, self._num_frames, T_base_camera)
            dropped = self._frames.dropped.total() + self._classifier.dropped.total()
            self._add_measurements(replace(measured, dropped=dropped))

    def _camera_pose(self, optical_frame: str) -> Array:
        if optical_frame not in self._camera_poses:  # cached: all static transforms were read before the run
            extrinsics, base_frame = self._perception.extrinsics, self._perception.base_frame
            pose = sensor_pose(extrinsics, base_frame, self._preamble.transforms, optical_frame)
            self._camera_poses[optical_frame] = pose
        return self._camera_poses[optical_frame]

    def _pass_on(self, measured: list[SemanticMeasurements]) -> None:
        for measurements in measured:
            if not self.is_done:
                self._add_measurements(replace(measurements, dropped=self._places.dropped.total()))

    def _add_measurements(self, measurements: SemanticMeasurements) -> None:
        self._num_frames += 1
        self._receiver.measured(_recorded(measurements))
        self._keyframes.add_measurements(measurements)

    def _infer(self, keyframes: list[Keyframe]) -> None:
        for keyframe in keyframes:
            if not self.is_done:
                self._receiver.keyframe(keyframe)
                self._num_keyframes += 1


def _recorded(measured: SemanticMeasurements) -> RawMessage:
    """Measurements as a message of the belief bag."""
    kind = CODECS[SemanticMeasurements].type_name
    return RawMessage(topics.MEASUREMENTS, kind, measured.stamp_ns, encode(measured))
