"""Node ``bag_player``: any rosbag2 onto the topics, in real time, faster, or losslessly in lock-step.

In lock-step it begins where the hypothesis manager stands: at the bag's start, or in a run that goes on shortly before
the newest frame done with. Where an earlier replay has ended, this one is another session. Live it begins at the start.

Parameters:
  bag                   rosbag2 folder, .mcap or .db3
  rate                  0 (default): lossless lock-step; 1: real time; more: faster
  window                detection frames under way at most, in lock-step (default 4)
  remap                 list of FROM:=TO, e.g. ["/camera/image:=image"]
  resume                in place of a player that died: live, too, it begins where the manager stands, and after the end
                        of a replay there is nothing left to do (default false)
  wait_for_listeners_s  how long to wait until every input has a listener (default 60)
"""

import sys
import threading
import time
from pathlib import Path

import rclpy
from tqdm import tqdm

from semantic_slam.bag.mcap_stream import RawMessage
from semantic_slam.bag.reader import BagReader
from semantic_slam.errors import InputError, MessageError
from semantic_slam.messages.codec import BY_TYPE_NAME, decode, encode, is_usable
from semantic_slam.messages.ground_truth import ReplayProgress
from semantic_slam.messages.standard import time_message
from semantic_slam.messages.topics import (
    CAMERA_INFO,
    CLASSIFIER_PROGRESS,
    CLOCK,
    MANAGER_PROGRESS,
    PLAYER_PROGRESS,
    TYPES,
)
from semantic_slam.messages.typestore import message_class, serialize
from semantic_slam.ros.node.health import dropped_status
from semantic_slam.ros.node.parameters import declare_fixed, refuse_undeclared
from semantic_slam.ros.node.pipeline_node import PipelineNode, main_of
from semantic_slam.ros.replay.flow_control import Credit
from semantic_slam.ros.replay.playlist import Playlist, parse_remaps
from semantic_slam.ros.replay.resumption import FROM_THE_START, Resumption, resumption
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet, is_installed, private_name, receive, relative_name

STALL_S = 30.0
GONE_S = 30.0
"""A manager that is missing for so long, besides the time that DDS needs to notice, does not come back."""
GRACE_S = 1.0
"""For which a manager may be unknown although somebody listens to the inputs."""
ONLOOKERS = ("bag_recorder", "doctor", "view")
"""Who hears everything and answers nothing."""
SECOND = 1_000_000_000


class BagPlayer(PipelineNode):
    """Publishes a bag; ``rate`` 0 keeps at most ``window`` detection frames under way."""

    def __init__(self) -> None:
        super().__init__("bag_player")
        bag = declare_fixed(self, "bag", "")
        self._rate = declare_fixed(self, "rate", 0.0)
        self._wait_s = declare_fixed(self, "wait_for_listeners_s", 60.0)
        remaps = parse_remaps(declare_fixed(self, "remap", [""]))
        self._credit = Credit(declare_fixed(self, "window", 4), STALL_S)
        self._resumes = declare_fixed(self, "resume", False)
        refuse_undeclared(self)
        if not bag:
            raise InputError("bag_player: parameter bag is empty; name the bag to replay")
        self._bag = Path(bag)
        self._finished = threading.Event()
        self._stands = threading.Event()  # the manager has said where
        self._done_stamp_ns = 0  # of the newest frame done with
        self._sent = 0
        self._has_ended = self._is_after_another = False  # what was sent; a replay before this one
        self._stamp_ns = 0
        self._had_manager = False
        self._gone_since_s: float | None = None
        with BagReader(self._bag) as reader:
            self._playlist = Playlist(reader.topics, remaps, is_installed)
        for line in self._playlist.notes:
            self.get_logger().info(f"{self._bag}: {line}")
        self._outlets = {
            topic: Outlet(self, item.name, item.type_name, qos.replayed(item.name))
            for topic, item in self._playlist.items.items()
        }
        self._clock_outlet = Outlet(self, CLOCK, TYPES[CLOCK], qos.newest())
        self._progress = Outlet(self, private_name(PLAYER_PROGRESS), TYPES[PLAYER_PROGRESS], qos.latched())
        self._classifier_progress = None
        if self._playlist.has_measurements:
            name = relative_name(CLASSIFIER_PROGRESS)
            self._classifier_progress = Outlet(self, name, TYPES[CLASSIFIER_PROGRESS], qos.latched())
        self._manager_topic = receive(self, MANAGER_PROGRESS, self._hear_manager, qos.latched_by_any())
        self.health.add_source(lambda: [dropped_status(self.refused.copy())])
        self.worker.submit(self._play, None)

    def _hear_manager(self, data: bytes) -> None:
        """At once: the worker waits for what is said here."""
        self.guarded(MANAGER_PROGRESS, lambda: self._manager_progress(data))

    def _manager_progress(self, data: bytes) -> None:
        progress: ReplayProgress = decode(data, TYPES[MANAGER_PROGRESS])
        if self._stands.is_set() and progress.finished and not self._has_ended:
            raise MessageError(f"{MANAGER_PROGRESS}: the end of a replay that goes on", "out of turn")
        if self._stands.is_set() and progress.frames <= self._credit.frames_done:
            self.repeated[MANAGER_PROGRESS] += 1
        if progress.finished and not self._has_ended:
            self._is_after_another = True
            self._stands.set()
            return
        # Messages of others that are no detections count as frames that the classifier lost.
        before = progress.frames if self._goes_on else 0
        self._credit.done(min(progress.frames, self._sent) if self._sent else before)
        self._done_stamp_ns = progress.stamp_ns
        self._stands.set()
        if progress.finished:
            self._finished.set()

    def _play(self, _: None) -> None:
        self._wait_for_listeners()
        self._wait_for_manager()
        if self._is_after_another and self._resumes:
            self.end()
            return
        damage = None
        with BagReader(self._bag) as bag, self._progress_bar(bag) as bar:
            start = self._start(bag)
            self._send_latched(bag)
            try:
                self._send_rest(bag, bar, start)
            except InputError as fault:  # the part before the damage is replayed to its end
                damage = fault
            self._end_of_bag(bar)
        if damage is not None:
            raise damage
        self.end()

    def _wait_for_listeners(self) -> None:
        give_up = time.monotonic() + self._wait_s
        inputs = [self._outlets[topic] for topic, item in self._playlist.items.items() if item.is_input]
        # A recorder takes everything and works on nothing: it must not be all that has come up so far.
        while rclpy.ok() and (
            unheard := [outlet.name for outlet in inputs if not outlet.has_listener_besides(ONLOOKERS)]
        ):
            if time.monotonic() > give_up:
                names = ", ".join(unheard)
                text = f"{self._bag}: nobody listens to {names} after {self._wait_s:.0f} s; start the other nodes"
                if self._rate == 0.0:
                    raise InputError(text)
                self.get_logger().warning(text)
                return
            time.sleep(0.02)

    def _wait_for_manager(self) -> None:
        """Until the manager has said where it stands; there may be none."""
        since_s = time.monotonic()
        while rclpy.ok() and not self._stands.wait(0.05):
            waited_s = time.monotonic() - since_s
            if waited_s > GRACE_S and (waited_s > self._wait_s or not self.count_publishers(self._manager_topic)):
                return

    @property
    def _goes_on(self) -> bool:
        """Whether a replay that was broken off is gone on with; live, only by a player that is started for that."""
        return self._rate == 0.0 or self._resumes

    def _start(self, bag: BagReader) -> Resumption:
        """Where to begin; the frames before count as sent."""
        if not (self._done_stamp_ns and self._goes_on):
            return FROM_THE_START
        frames = [topic for topic, item in self._playlist.items.items() if item.is_frame]
        start = resumption(filter(self._is_frame, bag.messages(frames)), self._done_stamp_ns)
        self._sent = start.frame
        self.get_logger().info(f"{self._bag}: goes on with frame {start.frame}")
        return start

    def _send_latched(self, bag: BagReader) -> None:
        """What later messages are understood by (initial pose, static transforms) goes first and arrives first."""
        latched = [topic for topic, item in self._playlist.items.items() if item.is_latched]
        for message in bag.messages(latched) if latched else ():
            self._outlets[message.topic].send(message.cdr)
        for topic in latched:
            self._outlets[topic].wait_for_acknowledgement()

    def _send_rest(self, bag: BagReader, bar: tqdm, start: Resumption) -> None:
        pace, frame, cameras = Pace(self._rate), -1, set[str]()
        for message in bag.messages([topic for topic, item in self._playlist.items.items() if not item.is_latched]):
            if not rclpy.ok():
                return
            item = self._playlist.items[message.topic]
            is_frame = self._is_frame(message)
            frame += is_frame
            if not start.takes(message, frame if is_frame else None):
                if item.name == CAMERA_INFO and message.topic not in cameras:  # the first one counts
                    self._send(message)
                cameras.add(message.topic)
                continue
            if is_frame:
                self._wait_for_credit(bar)
                self._sent += 1
            self._wait_while_paused(pace)
            pace.wait(message.stamp_ns)
            self._stamp_ns = message.stamp_ns
            self._send(message)

    def _is_frame(self, message: RawMessage) -> bool:
        """Whether somebody will say that he is done with it: not where it cannot be used."""
        item = self._playlist.items[message.topic]
        is_ours = item.type_name in BY_TYPE_NAME
        return item.is_frame and (not is_ours or is_usable(message.cdr, item.type_name))

    def _wait_while_paused(self, pace: "Pace") -> None:
        since_s = time.monotonic()
        while rclpy.ok() and not self.is_active:
            time.sleep(0.05)
            pace.shift(time.monotonic() - since_s)
            since_s = time.monotonic()

    def _send(self, message: RawMessage) -> None:
        clock = message_class(TYPES[CLOCK])(clock=time_message(message.stamp_ns))
        self._clock_outlet.send(serialize(clock))
        self._outlets[message.topic].send(message.cdr)

    def _wait_for_credit(self, bar: tqdm) -> None:
        if self._rate == 0.0 and self._manager_goes_on() and not self._credit.wait(self._sent, self._manager_goes_on):
            done = self._credit.frames_done
            self.get_logger().warning(f"no progress for {STALL_S:.0f} s at frame {done}; sending on")
        bar.update(self._credit.frames_done - bar.n)

    def _manager_goes_on(self) -> bool:
        """Whether there is a manager. Raises InputError when there was one, and it is gone for long."""
        if not rclpy.ok():
            return False
        if self.count_publishers(self._manager_topic) > 0:
            self._had_manager, self._gone_since_s = True, None
            return True
        if not self._had_manager or self._finished.is_set():
            return False
        now_s = time.monotonic()
        self._gone_since_s = self._gone_since_s or now_s
        if now_s - self._gone_since_s > GONE_S:
            raise InputError(
                f"{self._bag}: hypothesis_manager is gone; {self._credit.frames_done} of {self._sent} frames sent were"
                " used; see its last lines, start all nodes and replay again"
            )
        return True

    def _end_of_bag(self, bar: tqdm) -> None:
        for outlet in self._outlets.values():
            outlet.wait_for_acknowledgement()
        if self._classifier_progress is not None:
            self._classifier_progress.send(encode(ReplayProgress(0, frames=0, finished=True)))
        self._has_ended = True
        self._progress.send(encode(ReplayProgress(self._stamp_ns, frames=self._sent, finished=True)))
        while self._manager_goes_on() and not self._finished.wait(0.1):
            bar.update(self._credit.frames_done - bar.n)
        bar.update(self._credit.frames_done - bar.n)

    def _progress_bar(self, bag: BagReader) -> tqdm:
        frames = sum(bag.counts[topic] for topic, item in self._playlist.items.items() if item.is_frame)
        return tqdm(total=frames, unit="frame", desc=self._bag.name, file=sys.stderr, dynamic_ncols=True)


class Pace:
    """Real time times ``rate``; 0 never waits."""

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._start: tuple[int, float] | None = None

    def shift(self, by_s: float) -> None:
        """What is still to come is due so much later."""
        if self._start is not None:
            self._start = self._start[0], self._start[1] + by_s

    def wait(self, stamp_ns: int) -> None:
        """Sleep until the message of this log time is due."""
        if self._rate <= 0.0:
            return
        if self._start is None:
            self._start = (stamp_ns, time.monotonic())
        due = self._start[1] + (stamp_ns - self._start[0]) / SECOND / self._rate
        time.sleep(max(0.0, due - time.monotonic()))


main = main_of(BagPlayer, __doc__ or "")
