"""Node ``bag_recorder``: the belief and what explains it into a belief bag, as the offline pipeline writes it.

Parameters:
  bag        folder of the belief bag
  overwrite  true: an old bag is replaced once the new one is whole (default false)
  lossless   true in a replay by bag_player at rate 0 (default false)
"""

from pathlib import Path

from rclpy.clock import Clock, ClockType
from rclpy.qos import QoSProfile

from semantic_slam.bag.writer import BagWriter
from semantic_slam.errors import InputError, SemanticSlamError
from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode
from semantic_slam.messages.standard import header_stamp_ns
from semantic_slam.messages.typestore import deserialize
from semantic_slam.outputs import LEAVE_OF_NODES, claimed_bag
from semantic_slam.ros import qos
from semantic_slam.ros.parameters import refuse_undeclared
from semantic_slam.ros.pipeline_node import PipelineNode, main_of
from semantic_slam.ros.transport import is_installed

RESULTS = (topics.MEASUREMENTS, topics.BELIEF, topics.POSE)
FLUSH_S = 0.5
"""How often what was recorded is handed to the operating system: no more is lost when this process is killed."""
NEWEST = (topics.RUN_CONFIGURATION, topics.PATH, topics.MARKERS)


class BagRecorder(PipelineNode):
    """Writes parameter ``bag`` until the replay or the node ends. A gap in the keyframes is a fault."""

    def __init__(self) -> None:
        super().__init__("bag_recorder")
        path = str(self.declare_parameter("bag", "").value)
        overwrite = bool(self.declare_parameter("overwrite", False).value)
        refuse_undeclared(self)
        if not path:
            raise InputError("bag_recorder: parameter bag is empty; name the bag to write")
        self._claim = claimed_bag(Path(path), (), overwrite, LEAVE_OF_NODES)
        self._writer = BagWriter(self._claim.__enter__())
        self._writer.__enter__()
        self._stamp_ns = 0  # the newest stamp so far, for messages without one
        self._num_beliefs = 0
        for topic in RESULTS:
            self._record(topic, qos.result(self.lossless))
        for topic in NEWEST:
            self._record(topic, qos.latched())
        self._record(topics.DIAGNOSTICS, qos.everything(), ends=False)
        for topic in topics.KEPT_INPUTS:
            self._record(topic, qos.sensor_input(topic, self.lossless))
        self.listen(topics.MANAGER_PROGRESS, self._manager_progress, qos.latched())
        self.create_timer(FLUSH_S, self._queue_flush, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def close(self) -> None:
        """Write the bag's index; what was received is readable from then on, and takes an old bag's place if whole."""
        self._writer.__exit__(None, None, None)
        if not self._num_beliefs:  # an old bag is better than one without beliefs
            self._claim.__exit__(KeyboardInterrupt, KeyboardInterrupt(), None)
        elif self.fault is None:  # else it stays beside the old one
            self._claim.__exit__(None, None, None)

    def _queue_flush(self) -> None:
        self.worker.submit(lambda _: self._writer.flush(), None)

    def _record(self, topic: str, profile: QoSProfile, *, ends: bool = True) -> None:
        if is_installed(topics.TYPES[topic]):
            self.listen(topic, lambda data: self._write(topic, data), profile, ends=ends)

    def _write(self, topic: str, data: bytes) -> None:
        message = deserialize(data, topics.TYPES[topic])
        if topic == topics.BELIEF:
            self._check_sequence(int(message.keyframe))
        stamp_ns = header_stamp_ns(message) if hasattr(message, "header") else 0
        self._stamp_ns = max(self._stamp_ns, stamp_ns)
        if self._stamp_ns:  # before the first stamp there are but diagnostics of nodes that wait, which repeat
            self._writer.write_raw(topic, topics.TYPES[topic], data, stamp_ns or self._stamp_ns)

    def _check_sequence(self, keyframe: int) -> None:
        if keyframe != self._num_beliefs:
            raise SemanticSlamError(f"keyframe {keyframe} came where {self._num_beliefs} was due: beliefs were lost")
        self._num_beliefs += 1

    def _manager_progress(self, data: bytes) -> None:
        if decode(data, topics.TYPES[topics.MANAGER_PROGRESS]).finished:
            self.when_drained(lambda _: self.end(), None)


main = main_of(BagRecorder, __doc__ or "")
