"""The messages of a user's bag, one by one, as the messages of an input bag."""

from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from semantic_slam.bag.mcap_stream import RawMessage
from semantic_slam.bag.names import absolute
from semantic_slam.bag.reader import BagReader, TruncatedBagError
from semantic_slam.bag.writer import BagWriter
from semantic_slam.datasets.user_bag.camera_joints import read_camera_joints
from semantic_slam.datasets.user_bag.detection_formats import IN_THE_SENSOR, READERS, in_body
from semantic_slam.datasets.user_bag.detector_classes import class_names_of, with_class_names
from semantic_slam.datasets.user_bag.hints import Hints
from semantic_slam.datasets.user_bag.image_formats import compress_colour, compress_depth
from semantic_slam.datasets.user_bag.label_map import LabelMap
from semantic_slam.datasets.user_bag.sensor_frames import SensorFrames
from semantic_slam.datasets.user_bag.topics import Selection, Topic
from semantic_slam.datasets.user_bag.true_identities import TrueIdentities
from semantic_slam.errors import InputError
from semantic_slam.messages import topics
from semantic_slam.messages.codec import CODECS, from_message, to_message
from semantic_slam.messages.disparity import is_disparity
from semantic_slam.messages.ground_truth import GroundTruthAssociations
from semantic_slam.messages.sensor import TransformTree
from semantic_slam.messages.tf_odometry import TfOdometry
from semantic_slam.reasons import count

Handler = Callable[[RawMessage], None]
RAW_IMAGE = "sensor_msgs/msg/Image"
PASSED_ON = (
    topics.INITIAL_POSE,
    topics.GROUND_TRUTH_ODOMETRY,
    topics.GROUND_TRUTH_OBJECTS,
    topics.GROUND_TRUTH_ASSOCIATIONS,
)
"""Topics copied under their own names where they have the type that we expect."""


class Converter:
    """Writes what the selected topics hold, and counts everything by name."""

    def __init__(
        self,
        reader: BagReader,
        writer: BagWriter,
        selection: Selection,
        labels: LabelMap,
        odom_frame: str,
        base_frame: str,
    ) -> None:
        self.written: Counter[str] = Counter()  # by topic of the new bag
        self._dropped: Counter[str] = Counter()  # by reason
        self.ignored: Counter[str] = Counter()  # by topic of the old bag
        self.idle_depths: Counter[str] = Counter()  # likewise, of depth without pictures
        self._reader = reader
        self._writer = writer
        self._selection = selection
        self._labels = labels
        self._identities = TrueIdentities() if labels.mapping is not None else None  # None: all rows are kept
        self._fixed = self._fixed_transforms()
        self._tf = TfOdometry(odom_frame, base_frame, self._fixed)
        self._joints = read_camera_joints(reader, selection, base_frame, self._fixed)
        self._hints = Hints(base_frame, self._fixed, self._joints)
        self._sensors = SensorFrames(base_frame, self._fixed, self._odometry_frames())
        self._class_names = self._all_class_names()
        self._handlers = self._choose_handlers(selection)

    def convert(self, message: RawMessage) -> bool:
        """Convert one message; True when it was the detections of a frame."""
        handler = self._handlers.get(message.topic)
        if handler is None:
            is_idle = message.topic in {topic.name for topic in self._selection.idle_depths}
            (self.idle_depths if is_idle else self.ignored)[message.topic] += 1
            return False
        try:
            handler(message)
        except InputError as fault:  # one message; the others may be good
            count(self._dropped, str(fault))
        return message.topic == self._selection.detections.name

    @property
    def dropped(self) -> Counter[str]:
        """Numbers of messages that are not in the new bag, by reason."""
        return self._dropped + (self._identities.dropped if self._identities else Counter())

    def check_complete(self) -> None:
        """Raise InputError when nothing usable came from a topic that was chosen."""
        selection = self._selection
        needed = {
            topics.DETECTIONS: selection.detections,
            topics.IMAGE_COMPRESSED: selection.image,
            topics.CAMERA_INFO: selection.camera_info,
            topics.ODOMETRY: selection.odometry,
        }
        for name, topic in needed.items():
            if topic is not None and not self.written[absolute(name)]:
                raise InputError(f"{self._reader.path}: nothing on {topic} was usable; {self._remedy(topic)}")

    def hints(self) -> list[str]:
        """What a run of the new bag would stumble over, a line each."""
        return self._hints.lines(
            has_images=self._selection.image is not None,
            moves_positions=self._selection.detections.type_name in IN_THE_SENSOR,
        )

    def _remedy(self, topic: Topic) -> str:
        if topic.type_name != topics.TYPES[topics.TF]:
            return "see the reasons above, or choose another topic"
        return f"it lacks {self._tf.lack}; name the frames with --odom-frame and --base-frame"

    def _fixed_transforms(self) -> TransformTree:
        """All static transforms, wherever in the bag they are."""
        tree = TransformTree()
        topic = self._selection.tf_static
        with suppress(TruncatedBagError):  # said again, and not suppressed, when the bag is converted
            for message in self._reader.messages([topic.name]) if topic else ():
                tree.add(self._decode(message))
        return tree

    def _odometry_frames(self) -> tuple[str, str]:
        """Frames of the odometry and of the body in it, by its first message; "" where not known."""
        topic = self._selection.odometry
        if topic.type_name == topics.TYPES[topics.TF]:
            return self._tf.odom_frame, self._tf.base_frame
        with suppress(InputError):  # damage, or a message that does not decode: said when the bag is converted
            first = self._decode(next(self._reader.messages([topic.name])))
            return first.header.frame_id, first.child_frame_id
        return "", ""

    def _all_class_names(self) -> tuple[str, ...]:
        """Every class that the detector names anywhere in the bag."""
        named: set[str] = set()
        with suppress(TruncatedBagError):  # said again when the bag is converted
            for message in self._reader.messages([self._selection.detections.name]):
                with suppress(InputError):  # counted when the message is converted
                    named |= class_names_of(READERS[message.type_name](self._decode(message)))
        return tuple(sorted(named))

    def _choose_handlers(self, selection: Selection) -> dict[str, Handler]:
        """What to do with each topic of the old bag, by its name."""
        handlers = {
            absolute(name): self._copy_to(name)
            for name in PASSED_ON
            if self._reader.topics.get(absolute(name)) == topics.TYPES[name]
        }
        if self._identities is not None and topics.GROUND_TRUTH_ASSOCIATIONS in handlers:
            handlers[topics.GROUND_TRUTH_ASSOCIATIONS] = self._associations
        if selection.tf_static is not None:
            handlers[selection.tf_static.name] = self._copy_to(topics.TF_STATIC)
        if self._joints is not None and self._joints.carry_camera:
            handlers[selection.moving_transforms] = self._copy_to(topics.TF)
        is_tf = selection.odometry.type_name == topics.TYPES[topics.TF]
        odometry = self._odometry_from_tf if is_tf else self._copy_to(topics.ODOMETRY)
        handlers[selection.odometry.name] = _in_turn(handlers.get(selection.odometry.name), odometry)
        handlers[selection.detections.name] = self._detections
        if selection.imu is not None:
            handlers[selection.imu.name] = self._copy_to(topics.IMU)
        if selection.camera_info is not None:
            handlers[selection.camera_info.name] = self._copy_to(topics.CAMERA_INFO)
        if selection.image is not None:
            handlers[selection.image.name] = self._images(selection.image)
        if selection.depth is not None:
            handlers[selection.depth.name] = self._depths()
        return handlers

    def _depths(self) -> Handler:
        """Depth images and disparities become depth images; the stereo pair of the latter is worth a hint."""

        def convert(message: RawMessage) -> None:
            decoded = self._decode(message)
            self._write(topics.DEPTH_COMPRESSED, compress_depth(decoded, message.topic), message.stamp_ns)
            if is_disparity(decoded) and self._hints.wants(topics.DISPARITY):
                self._hints.see(topics.DISPARITY, decoded)

        return convert

    def _images(self, topic: Topic) -> Handler:
        """Raw colour images are compressed, others copied."""
        if topic.type_name == RAW_IMAGE:
            return self._convert_to(topics.IMAGE_COMPRESSED, compress_colour)
        return self._copy_to(topics.IMAGE_COMPRESSED)

    def _copy_to(self, name: str) -> Handler:
        """A handler that copies a message's bytes unchanged to the topic ``name``."""

        def copy(message: RawMessage) -> None:
            self._writer.write_raw(name, message.type_name, message.cdr, message.stamp_ns)
            self.written[absolute(name)] += 1
            if self._hints.wants(name):
                self._hints.see(name, self._decode(message))

        return copy

    def _convert_to(self, name: str, conversion: Callable[[Any, str], Any]) -> Handler:
        """What ``conversion`` makes of the decoded message."""

        def convert(message: RawMessage) -> None:
            self._write(name, conversion(self._decode(message), message.topic), message.stamp_ns)

        return convert

    def _detections(self, message: RawMessage) -> None:
        detections = with_class_names(READERS[message.type_name](self._decode(message)), self._class_names)
        detections = in_body(detections, message.type_name, self._tf.base_frame, self._sensors.pose)
        wanted, kept = self._labels.apply(detections)
        self._write(topics.DETECTIONS, wanted, message.stamp_ns)
        if self._identities is not None:
            self._write_identities(self._identities.frame(detections.stamp_ns, len(detections), kept), message.stamp_ns)

    def _associations(self, message: RawMessage) -> None:
        """True identities of the detections that the label file keeps."""
        assert self._identities is not None
        self._write_identities(self._identities.associations(from_message(self._decode(message))), message.stamp_ns)

    def _write_identities(self, identities: GroundTruthAssociations | None, stamp_ns: int) -> None:
        if identities is not None:
            self._write(topics.GROUND_TRUTH_ASSOCIATIONS, identities, stamp_ns)

    def _odometry_from_tf(self, message: RawMessage) -> None:
        for estimate in self._tf.read(self._decode(message)):
            self._write(topics.ODOMETRY, estimate, message.stamp_ns)
        if self._tf.num_repeated:
            self._dropped[f"{topics.TF}: odometry of a stamp that it had before"] = self._tf.num_repeated

    def _decode(self, message: RawMessage) -> Any:
        return self._reader.decode(message.cdr, message.type_name)

    def _write(self, name: str, value: Any, stamp_ns: int) -> None:
        self._writer.write(name, value, stamp_ns)
        self.written[absolute(name)] += 1
        if self._hints.wants(name):
            self._hints.see(name, to_message(value) if type(value) in CODECS else value)


def _in_turn(first: Handler | None, then: Handler) -> Handler:
    """Both handlers of one message: /tf may hold the odometry and carry the camera."""
    if first is None:
        return then

    def handle(message: RawMessage) -> None:
        first(message)
        then(message)

    return handle
