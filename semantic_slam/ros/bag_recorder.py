"""Node ``bag_recorder``: records beliefs and their inputs into a belief bag, like that of the offline pipeline.

Each further session of the manager goes into a bag of its own: BAG_2, BAG_3 and so on. So does what a manager
publishes after it went back to an earlier keyframe, as from a damaged journal.

Parameters:
  bag        folder of the belief bag
  overwrite  true: replace an old bag once the new one is complete (default false)
  has_imu    also record topic imu (default false)
  resume     true: continue a bag whose recorder was killed (default false)
  lossless   true in a replay by bag_player at rate 0 (default false)
"""

import time
from collections.abc import Mapping
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

from rclpy.clock import Clock, ClockType
from rclpy.qos import QoSProfile

from semantic_slam.bag.continuation import Continuation, unfinished_bag
from semantic_slam.bag.mcap_stream import RawMessage
from semantic_slam.bag.names import absolute
from semantic_slam.bag.writer import BagWriter
from semantic_slam.errors import InputError, MessageError, SemanticSlamError
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.run_id import is_id_of_its_contents
from semantic_slam.messages import topics
from semantic_slam.messages.codec import BY_TYPE_NAME, decode, from_message
from semantic_slam.messages.node_status import is_of_another_robot
from semantic_slam.messages.standard import header_stamp_ns
from semantic_slam.messages.typestore import deserialize
from semantic_slam.outputs import LEAVE_OF_NODES, claimed_again, claimed_bag
from semantic_slam.ros.node.health import dropped_status
from semantic_slam.ros.node.parameters import declare_fixed, refuse_undeclared
from semantic_slam.ros.node.pipeline_node import PASSED, PipelineNode, main_of
from semantic_slam.ros.node.repeats import Repeats
from semantic_slam.ros.recording.recent_inputs import RecentInputs
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import is_installed

RESULTS = (topics.MEASUREMENTS, topics.BELIEF, topics.POSE)
FLUSH_S = 0.5
"""Flush period: the most that is lost when this process is killed."""
PATIENCE_S = 5.0
"""How long to wait for the next belief while consecutive later ones have already arrived."""
STAMP_END = 12
"""Length in bytes of a serialised message up to and including its header stamp."""
NEWEST = (topics.RUN_CONFIGURATION, topics.PATH, topics.MARKERS)


class Ahead(NamedTuple):
    """The newest belief of a consecutive series that arrived ahead of the expected keyframe."""

    keyframe: int
    stamp_ns: int
    first: int  # keyframe of the first belief of the series
    since_s: float  # when that one arrived, by the monotonic clock


class BagRecorder(PipelineNode):
    """Records into parameter ``bag`` until the replay or the node ends; a gap in the keyframes is an error."""

    most_behind: Mapping[str, int] = {}  # no limit: recordings are complete, and disks are faster than sensors

    def __init__(self) -> None:
        super().__init__("bag_recorder")
        path = declare_fixed(self, "bag", "")
        overwrite = declare_fixed(self, "overwrite", False)
        resume = declare_fixed(self, "resume", False)
        has_imu = declare_fixed(self, "has_imu", False)
        refuse_undeclared(self)
        if not path:
            raise InputError("bag_recorder: parameter bag is empty; name the bag to write")
        self._repeats = Repeats(self.repeated)
        self._inputs = RecentInputs()
        self._path = Path(path)
        self._stamp_ns = 0  # for messages without a stamp: of the newest belief; before the first, the newest of all
        self._num_beliefs, self._belief_stamp_ns = 0, -1
        self._ahead: Ahead | None = None
        self._has_gap = False  # beliefs may have been missed since the last recorded one: not active, dead, not there
        self._run: Any = None  # newest configuration received of the run that is recorded
        self._run_id = ""
        self._next_run: Any = None  # configuration of another session whose first belief has not arrived yet
        self._ends_at_ns: int | None = None  # stamp of the replay's last belief
        self._begin(*(unfinished_session(self._path) if resume else (self._path, None)), overwrite)
        self.health.add_source(lambda: [dropped_status(self.refused.copy())])
        for topic in NEWEST:  # subscribed first, so that a run's configuration is handled before its beliefs
            self._record(topic, qos.latched_by_any(), waits=False)
        for topic in RESULTS:
            self._record(topic, qos.result(self.lossless), waits=False)
        self._record(topics.DIAGNOSTICS, qos.everything(), ends=False, waits=False)
        for topic in topics.KEPT_INPUTS:
            if topic != topics.IMU or has_imu:
                self._record(topic, qos.sensor_input(topic, self.lossless))
        self.listen(topics.MANAGER_PROGRESS, self._manager_progress, qos.latched_by_any(), waits=False)
        self.create_timer(FLUSH_S, self._queue_flush, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _begin(self, path: Path, unfinished: Path | None, overwrite: bool) -> None:
        """Open the bag; ``unfinished`` is one that a killed recorder left, whose messages are taken over."""
        self._bag, self._has_gap = path, not self.lossless
        if unfinished is None:
            self._claim = claimed_bag(path, (), overwrite, LEAVE_OF_NODES)
            self._writer = BagWriter(self._claim.__enter__())
            self._writer.__enter__()
            return
        self._claim = claimed_again(path, unfinished)
        earlier = Continuation(self._claim.__enter__())
        self._writer = BagWriter(unfinished)
        self._writer.__enter__()
        for message, definition in earlier.messages():
            self._take_over(message, definition)
        self._writer.flush()
        for line in earlier.done(path):
            self.get_logger().warning(line)
        self.get_logger().info(f"{path}: goes on after keyframe {self._num_beliefs - 1}")

    def _take_over(self, message: RawMessage, definition: str) -> None:
        if self._repeats.is_known(message.topic, _key(message.topic, message.cdr)):
            return
        if message.topic == topics.RUN_CONFIGURATION:
            self._run_id = str(deserialize(message.cdr, message.type_name).run_id)
        if message.topic == topics.BELIEF:
            belief = deserialize(message.cdr, message.type_name)
            self._num_beliefs, self._belief_stamp_ns = int(belief.keyframe) + 1, header_stamp_ns(belief)
        self._stamp_ns = max(self._stamp_ns, message.stamp_ns)
        self._writer.write_raw(message.topic, message.type_name, message.cdr, message.stamp_ns, definition)

    def close(self) -> None:
        """Write the bag's index, which makes it readable; a complete bag then replaces an old one.

        A bag that the worker still writes, to a disk that hangs, is left as a killed recorder leaves it.
        """
        if self.worker.is_working:
            text = "is still being written and was left unfinished; go on with it by resume:=true"
            self.fault = self.fault or SemanticSlamError(f"{self._path}: {text}")
            return
        if left := sum(item is not None for item in self.worker.left()):  # the other calls flush
            text = f"{left} messages were not written, as the node ended before their turn"
            self.get_logger().warning(f"{self._path}: {text}")
        self._finish_bag()

    def _failed(self, fault: Exception) -> None:
        """Keep the fault; one of writing also after SIGTERM, when those of publishing are none."""
        if isinstance(fault, SemanticSlamError):
            self.fault = fault
        super()._failed(fault)

    def _finish_bag(self) -> None:
        self._writer.__exit__(None, None, None)
        if not self._num_beliefs:  # without beliefs the old bag is kept
            self._claim.__exit__(KeyboardInterrupt, KeyboardInterrupt(), None)
        elif self.fault is None:  # after a fault the new bag stays beside the old one
            self._claim.__exit__(None, None, None)

    def _queue_flush(self) -> None:
        if self.is_active:
            self.worker.submit(lambda _: self._writer.flush(), None)

    def resume(self) -> None:
        """Start or resume recording; messages that passed while not active are missing from the bag."""
        if self.refused[f"{topics.BELIEF}: {PASSED}"]:
            self.worker.submit(self._note_gap, None)
        super().resume()

    def _note_gap(self, _: None) -> None:
        self._has_gap = True

    def _record(self, topic: str, profile: QoSProfile, *, ends: bool = True, waits: bool = True) -> None:
        if is_installed(topics.TYPES[topic]):
            self.listen(topic, lambda data: self._write(topic, data), profile, ends=ends, waits=waits)

    def _write(self, topic: str, data: bytes) -> None:
        message = deserialize(data, topics.TYPES[topic])
        value = from_message(message) if topics.TYPES[topic] in BY_TYPE_NAME else None
        if topic == topics.DIAGNOSTICS and is_of_another_robot(message.status, self.get_namespace()):
            return
        if isinstance(value, RunConfiguration) and not is_id_of_its_contents(value):
            raise MessageError(f"{topic}: its id is not that of its contents", "id of another run")
        stamp_ns = header_stamp_ns(message) if hasattr(message, "header") else 0
        if self._is_repeated(topic, data):
            return
        self._inputs.note(topic, data, stamp_ns)
        if topic == topics.RUN_CONFIGURATION and self._is_of_another_session(message):
            return
        if topic == topics.BELIEF and self._is_of_next_run(message):
            self._begin_session()
        elif topic == topics.BELIEF and self._is_of_another_history(message):
            self._begin_history(message)
        if topic == topics.BELIEF and not self._is_due(int(message.keyframe), stamp_ns):
            self._repeats.forget(absolute(topic), _key(topic, data))  # not used: it may arrive again in its turn
            return
        self._write_raw(topic, data, stamp_ns)

    def _write_raw(self, topic: str, data: bytes, stamp_ns: int) -> None:
        if topic == topics.BELIEF or not self._num_beliefs:  # stamps of beliefs are checked, those of inputs are not
            self._stamp_ns = max(self._stamp_ns, stamp_ns)
        if self._stamp_ns:  # before the first stamp only diagnostics of waiting nodes arrive, which are periodic
            self._writer.write_raw(topic, topics.TYPES[topic], data, stamp_ns or self._stamp_ns)

    def _is_of_another_session(self, run: Any) -> bool:
        """Whether this announces another run than the recorded one; beliefs of the recorded one may still arrive."""
        self._run_id = self._run_id or str(run.run_id)
        self._next_run = run if run.run_id != self._run_id else None
        self._run = run if self._next_run is None else self._run
        return self._next_run is not None

    def _is_of_next_run(self, belief: Any) -> bool:
        """Whether a belief is the first received one of the announced session; earlier ones may have been missed."""
        if self._next_run is None:
            return False
        is_later = header_stamp_ns(belief) >= header_stamp_ns(self._next_run)
        return bool(belief.keyframe == 0 or (self._has_gap and is_later))

    def _begin_session(self) -> None:
        """Start another bag, with the messages of the new session that have already arrived."""
        self._run, self._next_run = self._next_run, None
        self._run_id = str(self._run.run_id)
        place = free_session(self._path)
        self.get_logger().info(f"another session begins: {place}")
        self._begin_bag(place, header_stamp_ns(self._run))

    def _begin_bag(self, place: Path, first_stamp_ns: int) -> None:
        """Finish the bag and begin another one, with the inputs received from ``first_stamp_ns`` on."""
        self._finish_bag()
        self._stamp_ns, self._num_beliefs, self._belief_stamp_ns = 0, 0, -1
        self._begin(place, None, overwrite=False)
        for item in self._inputs.of_session(first_stamp_ns):
            self._write_raw(item.topic, item.data, item.stamp_ns or first_stamp_ns)

    def _is_of_another_history(self, belief: Any) -> bool:
        """Whether a live manager states a recorded keyframe anew, of a later time than all that are recorded.

        What a restarted manager publishes again has the stamp that it had. The first keyframe may be that of a session
        whose announcement is still on its way.
        """
        if self.lossless or self._next_run is not None or belief.keyframe >= self._num_beliefs:
            return False
        announced = self._belief_stamp_ns < (header_stamp_ns(self._run) if self._run is not None else 0)
        return header_stamp_ns(belief) > self._belief_stamp_ns and bool(belief.keyframe or announced)

    def _begin_history(self, belief: Any) -> None:
        """Start another bag at this belief: the recorded ones from its keyframe on are of a history that is gone."""
        index, former, place = int(belief.keyframe), self._bag, free_session(self._path)
        self.get_logger().warning(
            f"{former}: what it has from keyframe {index} on is of a history that is gone, as the manager went back to"
            f" an earlier keyframe; what comes is recorded in {place}"
        )
        self._begin_bag(place, header_stamp_ns(belief))
        self._num_beliefs = index

    def _is_repeated(self, topic: str, data: bytes) -> bool:
        """Whether a replay resumed after a crash sends a message that is already recorded."""
        is_of_replay = self.lossless and topic != topics.DIAGNOSTICS
        return is_of_replay and self._repeats.is_known(absolute(topic), _key(topic, data))

    def _is_due(self, keyframe: int, stamp_ns: int) -> bool:
        """Whether a belief is the next one expected; raises SemanticSlamError if some before it were lost."""
        if keyframe < self._num_beliefs:  # repeated by a restarted manager
            self.repeated[topics.BELIEF] += 1
            return False
        if keyframe != self._num_beliefs and not self._has_gap:
            self._note_ahead(keyframe, stamp_ns)
            return False
        self._refuse_ahead()
        if keyframe != self._num_beliefs:
            text = f"{self._bag}: keyframes {self._num_beliefs} to {keyframe - 1} were not recorded"
            remedy = "" if self._num_beliefs else "; for all of them start this node before the run, or call ~/reset"
            self.get_logger().warning(f"{text}{remedy}")
        self._num_beliefs, self._belief_stamp_ns, self._has_gap = keyframe + 1, stamp_ns, False
        return True

    def _note_ahead(self, keyframe: int, stamp_ns: int) -> None:
        """Note a belief ahead of the expected one. Raises SemanticSlamError if those in between were lost.

        A single one is refused, as it may be a copy from another publisher. If consecutive ones keep arriving for
        ``PATIENCE_S``, the beliefs in between were lost.
        """
        before, follows = self._ahead, self._ahead is not None and keyframe == self._ahead.keyframe + 1
        self._refuse_ahead()
        self._ahead = Ahead(keyframe, stamp_ns, keyframe, time.monotonic())
        if before is not None and follows:
            self._ahead = self._ahead._replace(first=before.first, since_s=before.since_s)
            self._fail_if_lost()

    def _refuse_ahead(self) -> None:
        if self._ahead is not None:
            self.refused[f"{topics.BELIEF}: out of turn"] += 1
            self._ahead = None

    def _fail_if_lost(self) -> None:
        """Raises SemanticSlamError if the expected belief is missing ``PATIENCE_S`` after its successors began."""
        if self._ahead is not None and time.monotonic() - self._ahead.since_s > PATIENCE_S:
            came, due = self._ahead.first, self._num_beliefs
            raise SemanticSlamError(f"keyframe {came} came where {due} was due: beliefs were lost")

    def _manager_progress(self, data: bytes) -> None:
        progress = decode(data, topics.TYPES[topics.MANAGER_PROGRESS])
        if progress.finished and progress.stamp_ns < self._belief_stamp_ns:
            raise MessageError(f"{topics.MANAGER_PROGRESS}: an end before the newest belief", "out of turn")
        if not progress.finished:
            self._is_repeated(topics.MANAGER_PROGRESS, data)
        self._ends_at_ns = progress.stamp_ns if progress.finished else None
        if progress.finished:
            self.when_drained(self._end, None)

    def _end(self, _: None) -> None:
        """End once the last belief is recorded, which may still be in transit; not if another session has begun."""
        if self._ends_at_ns is None:
            return
        if self._belief_stamp_ns >= self._ends_at_ns:
            self.end()
            return
        if self._ahead is not None and self._ahead.stamp_ns == self._ends_at_ns:
            self._fail_if_lost()
        self.when_drained(self._end, None)


def session_place(path: Path, number: int) -> Path:
    """Path of the bag of a session; number 1 is the first."""
    return path if number == 1 else path.with_name(f"{path.name}_{number}")


def free_session(path: Path) -> Path:
    """Path for the next session's bag, one that is not taken: nothing is overwritten during a drive."""
    places = (session_place(path, number) for number in count(2))
    return next(place for place in places if not place.exists() and unfinished_bag(place) is None)


def unfinished_session(path: Path) -> tuple[Path, Path | None]:
    """Bag of the session whose recorder was killed, and where its unfinished data lie; ``path`` and None if none."""
    for number in count(1):
        place = session_place(path, number)
        if (left := unfinished_bag(place)) is not None:
            return place, left
        if not place.exists():
            break
    return path, None


def _key(topic: str, data: bytes) -> bytes:
    """Bytes that identify a message; for measurements up to the stamp, as a restarted classifier counts from zero."""
    return data[:STAMP_END] if topic == topics.MEASUREMENTS else data


main = main_of(BagRecorder, __doc__ or "")
