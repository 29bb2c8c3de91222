"""Node ``classifier``: takes images and detections, publishes semantic measurements.

Without images it uses the positions in the detections, loads no network and waits for no images.

Parameters, besides those of config/default.yaml:
  has_images       classify the image crops in the boxes (default true); false: use the positions in the detections, or
                   their boxes with the intrinsics of camera_info
  has_depth        wait for the depth image of each image (default true); false: bearing-only measurements
  has_moving_camera wait for the transform on /tf of a camera that moves relative to the robot (default false)
  compressed       true: subscribe to image/compressed, false: to image; not set: to the one that has a publisher
  depth_compressed true: subscribe to depth/compressed, false: to depth; not set: to the one that has a publisher
  detections_type  message type of topic detections (default semantic_slam_msgs/msg/DetectionArray); with vision_msgs
                   installed also vision_msgs/msg/Detection2DArray or, without images, Detection3DArray
  lossless         true in a replay by bag_player at rate 0 (default false)
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rclpy.serialization import deserialize_message

from semantic_slam.datasets.user_bag.detection_formats import READERS, in_body
from semantic_slam.errors import InputError, MessageError
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode, encode, is_usable, to_message
from semantic_slam.messages.ground_truth import ReplayProgress
from semantic_slam.messages.sensor import TransformTree, sensor_pose
from semantic_slam.messages.typestore import deserialize
from semantic_slam.perception.frame import Frame
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.pipeline.assembly.frame_assembler import FrameAssembler
from semantic_slam.pipeline.assembly.places_assembler import PlacesAssembler
from semantic_slam.pipeline.build_classifier import build_classifier
from semantic_slam.reasons import count
from semantic_slam.ros.node.health import dropped_status, waiting_status
from semantic_slam.ros.node.parameters import declare_configuration, declare_fixed, refuse_undeclared
from semantic_slam.ros.node.pipeline_node import PipelineNode, main_of
from semantic_slam.ros.node.repeats import Repeats
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet, is_installed, private_name, ros_type

OURS = topics.TYPES[topics.DETECTIONS]


class ClassifierNode(PipelineNode):
    """ROS node that wraps the frame assembler and the classifier; without images, the places assembler."""

    def __init__(self) -> None:
        super().__init__("classifier")
        configuration = declare_configuration(self)
        self._configuration, self._perception = configuration, configuration.perception
        has_images = declare_fixed(self, "has_images", True)
        has_depth = declare_fixed(self, "has_depth", True)
        self._classifier = build_classifier(configuration, self.get_logger().warning) if has_images else None
        self._transforms = TransformTree()
        moves = declare_fixed(self, "has_moving_camera", False) and is_installed(topics.TYPES[topics.TF])
        self._has_depth, self._moving = has_depth, self._transforms if moves else None
        self._dropped: Counter[str] = Counter()
        self._begin()
        self._measurements = self._outlet(topics.MEASUREMENTS, qos.result(self.lossless))
        self._progress = self._outlet(topics.CLASSIFIER_PROGRESS, qos.latched())
        self._listen(
            has_depth=has_depth,
            has_moving_camera=moves,
            detections_type=declare_fixed(self, "detections_type", OURS),
        )
        refuse_undeclared(self)
        self._statuses = [dropped_status(self._dropped)]  # replaced by the worker, published by the executor
        self.health.add_source(lambda: self._statuses)

    def _begin(self) -> None:
        """Start a session: reset the assemblers, the counts and the record of received messages."""
        self._frames = FrameAssembler(self._configuration, self._has_depth, self._moving)
        self._places = PlacesAssembler(self._configuration, self._sensor_pose, self._transforms)
        self._repeats = Repeats(self.repeated)
        self._received = 0  # detection messages
        self._measured = 0
        self._announced = 0
        self._stamp_ns = 0
        self._is_finished = False

    def _go_on_after_end(self) -> None:
        """If the replay has ended, start another session; it keeps the camera until a new camera_info arrives."""
        if self._is_finished:
            frames, places = self._frames, self._places
            self._begin()
            self._frames.keep_camera_of(frames)
            self._places.keep_camera_of(places)
            self.health.finished = False

    def _go_on_after_set_back(self) -> None:
        """Start another session if the stamps went back, as when a bag is played again."""
        frames, places = self._frames, self._places
        if self._assembler.is_over:
            self._work(at_end=True)
            self._frames = FrameAssembler(self._configuration, self._has_depth, self._moving)
            self._places = PlacesAssembler(self._configuration, self._sensor_pose, self._transforms)
            self._frames.go_on_from(frames)
            self._places.go_on_from(places)
            self._work()

    @property
    def _assembler(self) -> FrameAssembler | PlacesAssembler:
        """The assembler in use: of frames, or without a classifier of places."""
        return self._places if self._classifier is None else self._frames

    def _outlet(self, topic: str, profile: Any) -> Outlet:
        return Outlet(self, private_name(topic), topics.TYPES[topic], profile)

    def _listen(self, *, has_depth: bool, has_moving_camera: bool, detections_type: str) -> None:
        has_images = self._classifier is not None
        camera_info = self._decoded(topics.CAMERA_INFO, lambda message: self._assembler.add_camera_info(message))
        profile = qos.sensor_input(topics.CAMERA_INFO, self.lossless)
        self.listen(topics.CAMERA_INFO, camera_info, profile, required=has_images)
        self._look_for(
            "compressed", (topics.IMAGE_COMPRESSED, topics.IMAGE), lambda m: self._frames.add_image(m), has_images
        )
        wants_depth = has_images and has_depth
        depths: tuple[str, ...] = (topics.DEPTH_COMPRESSED, topics.DEPTH)
        if is_installed(topics.TYPES[topics.DISPARITY]):
            depths += (topics.DISPARITY,)
        self._look_for("depth_compressed", depths, lambda message: self._frames.add_depth(message), wants_depth)
        self.listen(
            topics.DETECTIONS,
            self._detections_handler(detections_type),
            qos.sensor_input(topics.DETECTIONS, self.lossless),
            type_name=detections_type,
            required=True,
        )
        if is_installed(topics.TYPES[topics.TF_STATIC]):
            handle = self._decoded(topics.TF_STATIC, self._transforms.add)
            self.listen(topics.TF_STATIC, handle, qos.sensor_input(topics.TF_STATIC, self.lossless))
        if has_images and has_moving_camera:
            handle = self._decoded(topics.TF, lambda message: self._frames.add_transforms(message))
            self.listen(topics.TF, handle, qos.sensor_input(topics.TF, self.lossless), required=True)
        self.listen(topics.PLAYER_PROGRESS, self._player_progress, qos.latched_by_any())

    def _look_for(
        self, parameter: str, transports: tuple[str, ...], add: Callable[[Any], None], is_wanted: bool
    ) -> None:
        """Subscribe to the transport that ``parameter`` selects, the compressed one or the first of the others that has
        a publisher; if it is not set, to the first of all that has one."""
        given = parameter in self._parameter_overrides  # the value alone does not show whether it was set
        is_compressed = declare_fixed(self, parameter, True)
        if not is_wanted:
            return
        chosen = transports if not given else transports[:1] if is_compressed else transports[1:]
        handlers = {topic: self._decoded(topic, add) for topic in chosen}
        self.listen_to_one_of(handlers, lambda topic: qos.sensor_input(topic, self.lossless))

    def _decoded(self, topic: str, add: Callable[[Any], None]) -> Callable[[bytes], None]:
        def handle(data: bytes) -> None:
            if not self._is_repeated(topic, data):
                add(deserialize(data, topics.TYPES[topic]))
                self._work()
                self._go_on_after_set_back()

        return handle

    def _detections_handler(self, type_name: str) -> Callable[[bytes], None]:
        """Handler of detections, of our own type or of an installed package's. Raises InputError for other types."""
        if type_name not in READERS:
            raise InputError(f"parameter detections_type: {type_name} is not one of {', '.join(READERS)}")
        foreign = None if type_name == OURS else ros_type(type_name)

        def add(data: bytes) -> None:
            if self._is_repeated(topics.DETECTIONS, data):
                return
            if foreign is None:
                message = deserialize(data, OURS)
                self._received += is_usable(data, OURS)  # the player counts only usable messages as frames
            else:
                self._received += 1
                detections = READERS[type_name](_received(data, foreign))
                try:
                    message = to_message(in_body(detections, type_name, self._perception.base_frame, self._sensor_pose))
                except InputError as fault:  # the transform may still arrive for later messages
                    count(self._dropped, str(fault))
                    return
            self._assembler.add_detections(message)
            self._work()
            self._go_on_after_set_back()

        return add

    def _is_repeated(self, topic: str, data: bytes) -> bool:
        """Whether a restarted player sends a message that this node has already received in this session."""
        self._go_on_after_end()
        return self.lossless and self._repeats.is_known(topic, data)

    def _sensor_pose(self, frame_id: str) -> Array:
        """(7,) pose of a sensor frame, such as a camera's optical frame, in the body frame; raises InputError."""
        settings = self._perception
        return sensor_pose(settings.extrinsics, settings.base_frame, self._transforms, frame_id)

    def _work(self, *, at_end: bool = False) -> None:
        """Measure and publish the frames that are complete; ``at_end``: all remaining ones."""
        self._measure(self._frames.flush() if at_end else self._frames.take())
        for measured in self._places.flush() if at_end else self._places.take():
            self._send(measured)
        boxes = [waiting_status(self._places.num_without_camera)] if self._classifier is None else []
        self._statuses = [dropped_status(self._all_dropped()), *boxes]
        if self._num_lost() != self._announced:
            self._announce(finished=False)

    def _measure(self, frames: list[Frame]) -> None:
        for frame in frames:
            assert self._classifier is not None
            try:
                T_base_camera = frame.T_base_camera
                if T_base_camera is None:
                    T_base_camera = self._sensor_pose(frame.camera.frame_id)
            except InputError as fault:  # the transform may still arrive for later frames
                count(self._dropped, str(fault))
                continue
            self._send(self._classifier.measure(frame, self._measured, T_base_camera))

    def _send(self, measured: SemanticMeasurements) -> None:
        self._measured += 1
        self._stamp_ns = measured.stamp_ns
        self._measurements.send(encode(replace(measured, dropped=self._all_dropped().total())))

    def _num_lost(self) -> int:
        """Number of received detection messages that did not become a measurement."""
        return self._received - self._measured - self._assembler.num_waiting

    def _announce(self, *, finished: bool) -> None:
        """Publish how many frames were lost, so that a lossless replay does not wait for them."""
        self._announced = self._num_lost()
        self._progress.send(encode(ReplayProgress(self._stamp_ns, frames=self._announced, finished=finished)))

    def _player_progress(self, data: bytes) -> None:
        progress: ReplayProgress = decode(data, topics.TYPES[topics.PLAYER_PROGRESS])
        if not progress.finished or (progress.frames < self._measured and not self._is_finished):
            text = f"{topics.PLAYER_PROGRESS}: {progress.frames} frames sent, where {self._measured} were measured"
            raise MessageError(text, "out of turn")
        self.when_drained(self._end_of_replay, None)

    def _end_of_replay(self, _: None) -> None:
        self._work(at_end=True)
        self._is_finished = True
        self._measurements.wait_for_acknowledgement()
        self.health.finished = True
        self.health.publish()  # the final counts, before the recorder stops listening
        self._announce(finished=True)

    def _all_dropped(self) -> Counter[str]:
        classifier = Counter[str]() if self._classifier is None else self._classifier.dropped
        return self._assembler.dropped + classifier + self._dropped + self.refused.copy()


def _received(data: bytes, kind: Any) -> Any:
    """Deserialise a message of another package; raises MessageError."""
    try:
        return deserialize_message(data, kind)
    except Exception as fault:  # any failure of the deserialiser means that the bytes are invalid
        raise MessageError(f"{len(data)} bytes do not decode ({fault})", "message does not decode") from None


main = main_of(ClassifierNode, __doc__ or "")
