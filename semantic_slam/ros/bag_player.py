"""Node ``bag_player``: replays any rosbag2, in real time, faster, or losslessly in lock-step.

In lock-step it starts according to the hypothesis manager's progress: at the start of the bag or, if a run is being
resumed, shortly before the newest frame that was processed. After an earlier replay has ended, this one is another
session. With another rate it starts at the start of the bag.

Parameters:
  bag                   rosbag2 folder, .mcap or .db3
  rate                  0 (default): lossless lock-step; 1: real time; more: faster. May be set while the bag is played,
                        from one positive rate to another
  window                maximum number of detection frames in flight, in lock-step (default 4)
  remap                 list of FROM:=TO, e.g. ["/camera/image:=image"]
  resume                true for a player that replaces one that died: it resumes from the manager's progress at every
                        rate, and exits if the replay has already ended (default false)
  wait_for_listeners_s  how long to wait until every input topic has a subscriber (default 60)
"""

import sys
import threading
import time
from collections import Counter
from functools import partial
from pathlib import Path

import rclpy
from tqdm import tqdm

from semantic_slam.bag.mcap_stream import RawMessage
from semantic_slam.bag.reader import IN_A_MISSING_FILE, BagReader
from semantic_slam.errors import InputError, MessageError
from semantic_slam.messages.codec import BY_TYPE_NAME, decode, encode, is_usable
from semantic_slam.messages.ground_truth import ReplayProgress
from semantic_slam.messages.standard import time_message
from semantic_slam.messages.topics import (
    CAMERA_INFO,
    CLASSIFIER_PROGRESS,
    CLOCK,
    INITIAL_POSE,
    MANAGER_PROGRESS,
    ODOMETRY,
    PLAYER_PROGRESS,
    TYPES,
)
from semantic_slam.messages.typestore import message_class, serialize
from semantic_slam.pipeline.start_deadline import left_out_as_late, start_deadline_ns
from semantic_slam.ros.node.changes import Values, follow_changes
from semantic_slam.ros.node.health import dropped_status
from semantic_slam.ros.node.parameters import declare_changeable, declare_fixed, number, refuse_undeclared
from semantic_slam.ros.node.pipeline_node import PipelineNode, main_of
from semantic_slam.ros.replay.flow_control import Credit
from semantic_slam.ros.replay.playlist import Playlist, parse_remaps
from semantic_slam.ros.replay.resumption import FROM_THE_START, Resumption, resumption
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet, is_installed, private_name, receive, relative_name

STALL_S = 30.0
GONE_S = 30.0
"""A manager without a publisher for longer than this is taken as dead; DDS discovery time comes on top."""
GRACE_S = 1.0
"""How long the manager may stay undiscovered after the inputs have subscribers."""
ONLOOKERS = ("bag_recorder", "doctor", "view")
"""Nodes that only observe: their subscriptions do not count as listeners."""
SECOND = 1_000_000_000
LONGEST_SLEEP_S = 0.1
"""Delay after which a change of the rate takes effect."""


class BagPlayer(PipelineNode):
    """Publishes a bag; with ``rate`` 0 at most ``window`` detection frames are in flight."""

    def __init__(self) -> None:
        super().__init__("bag_player")
        bag = declare_fixed(self, "bag", "")
        self._rate = declare_changeable(self, "rate", 0.0)
        self._pace = Pace(self._rate)
        self._wait_s = declare_fixed(self, "wait_for_listeners_s", 60.0)
        remaps = parse_remaps(declare_fixed(self, "remap", [""]))
        self._credit = Credit(declare_fixed(self, "window", 4), STALL_S)
        self._resumes = declare_fixed(self, "resume", False)
        refuse_undeclared(self)
        if self._rate < 0.0:
            raise InputError(
                f"bag_player: parameter rate is {self._rate:g}; give 0 for lock-step, 1 for real time, or more"
            )
        if not bag:
            raise InputError("bag_player: parameter bag is empty; name the bag to replay")
        self._bag = Path(bag)
        self._finished = threading.Event()
        self._stands = threading.Event()  # set once the manager has published its progress
        self._done_stamp_ns = 0  # of the newest frame that was processed
        self._sent = 0
        self._has_ended = self._is_after_another = False  # the bag was sent to its end; a replay ended before this one
        self._stamp_ns = 0
        self._had_manager = False
        self._gone_since_s: float | None = None
        with BagReader(self._bag) as reader:
            self._playlist = Playlist(reader.topics, remaps, is_installed)
        for line in self._playlist.notes:
            self.get_logger().info(f"{self._bag}: {line}")
        # Inputs come first, as the classifier reads colour and depth from the first topic that it sees.
        self._outlets = {
            topic: Outlet(self, item.name, item.type_name, qos.replayed(item.name))
            for topic, item in sorted(self._playlist.items.items(), key=lambda entry: not entry[1].is_input)
        }
        self._clock_outlet = Outlet(self, CLOCK, TYPES[CLOCK], qos.newest())
        self._progress = Outlet(self, private_name(PLAYER_PROGRESS), TYPES[PLAYER_PROGRESS], qos.latched())
        self._classifier_progress = None
        if self._playlist.has_measurements:
            name = relative_name(CLASSIFIER_PROGRESS)
            self._classifier_progress = Outlet(self, name, TYPES[CLASSIFIER_PROGRESS], qos.latched())
        self._manager_topic = receive(self, MANAGER_PROGRESS, self._hear_manager, qos.latched_by_any())
        self.health.add_source(lambda: [dropped_status(self.refused.copy())])
        follow_changes(self, ("rate",), self._check_rate, lambda values: self._pace.change(float(values["rate"])))
        self.worker.submit(self._play, None)

    @property
    def _is_up(self) -> bool:
        """Whether to go on: the node is not shut down or interrupted."""
        return bool(rclpy.ok()) and not self.worker.is_ending

    def _check_rate(self, values: Values) -> None:
        rate = number(self, "rate", values.get("rate", self._rate))
        if "rate" in values and (self._rate == 0.0 or rate <= 0.0):
            raise InputError(
                f"rate is {rate:g}; a bag is played either in lock-step, at rate 0, or at a positive rate, as it began"
            )

    def _hear_manager(self, data: bytes) -> None:
        """Handle a progress message on the executor's thread, because the worker waits for it."""
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
        # Progress may exceed what was sent: messages of other publishers also count as frames that the classifier lost.
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
            for send in (self._send_latched, partial(self._send_rest, bar=bar, start=start)):
                try:
                    send(bag)
                except InputError as fault:  # finish the replay of the part before the damage
                    damage = fault
                    self._tell_missing(bag)
            if not self._is_up:  # the others must not take what was sent for the whole bag
                return
            self._end_of_bag(bar)
        if damage is not None:
            raise damage
        self.end()

    def _wait_for_listeners(self) -> None:
        give_up = time.monotonic() + self._wait_s
        inputs = [self._outlets[topic] for topic, item in self._playlist.items.items() if item.is_input]
        # Observers such as the recorder do not count: the nodes that process the inputs must be up.
        while self._is_up and (
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
        """Wait until the manager has published its progress; returns early if there seems to be no manager."""
        since_s = time.monotonic()
        while self._is_up and not self._stands.wait(0.05):
            waited_s = time.monotonic() - since_s
            if waited_s > GRACE_S and (waited_s > self._wait_s or not self.count_publishers(self._manager_topic)):
                return

    @property
    def _goes_on(self) -> bool:
        """Whether to resume an interrupted replay: in lock-step, or with parameter ``resume``."""
        return self._rate == 0.0 or self._resumes

    def _start(self, bag: BagReader) -> Resumption:
        """Where to start in the bag; earlier frames count as sent."""
        if not (self._done_stamp_ns and self._goes_on):
            return FROM_THE_START
        start = resumption(filter(self._is_frame, bag.messages(self._playlist.frames)), self._done_stamp_ns)
        self._sent = start.frame
        self.get_logger().info(f"{self._bag}: goes on with frame {start.frame}")
        return start

    def _send_latched(self, bag: BagReader) -> None:
        """Send latched topics (initial pose, static transforms) first, and wait until they are acknowledged.

        Poses that come too late to be the start are not sent: sent ahead of the frames, they would become it.
        """
        latched = [topic for topic, item in self._playlist.items.items() if item.is_latched]
        deadline_ns = start_deadline_ns(bag, self._playlist.named(ODOMETRY), self._playlist.frames)
        try:
            for message in bag.messages(latched) if latched else ():
                is_pose = self._playlist.items[message.topic].name == INITIAL_POSE
                if is_pose and deadline_ns is not None and message.stamp_ns > deadline_ns:
                    self.get_logger().info(f"{self._bag}: {left_out_as_late(message.stamp_ns, deadline_ns)}")
                else:
                    self._outlets[message.topic].send(message.cdr)
        finally:  # what comes before damage, too, must be there before the first frame
            for topic in latched:
                self._outlets[topic].wait_for_acknowledgement()

    def _send_rest(self, bag: BagReader, bar: tqdm, start: Resumption) -> None:
        frame, cameras, missing_by_ns = -1, set[str](), bag.missing_by_ns
        for message in bag.messages([topic for topic, item in self._playlist.items.items() if not item.is_latched]):
            if not self._is_up:
                return
            if missing_by_ns is not None and message.stamp_ns >= missing_by_ns:
                self._tell_missing(bag)
                missing_by_ns = None
            item = self._playlist.items[message.topic]
            is_frame = self._is_frame(message)
            frame += is_frame
            if not start.takes(message, frame if is_frame else None):
                if item.name == CAMERA_INFO and message.topic not in cameras:  # nodes use the first camera_info
                    self._send(message)
                cameras.add(message.topic)
                continue
            if is_frame:
                self._wait_for_credit(bar)
                self._sent += 1
            self._wait_while_paused()
            self._pace.wait(message.stamp_ns)
            self._stamp_ns = message.stamp_ns
            self._send(message)

    def _tell_missing(self, bag: BagReader) -> None:
        """Count and log, once, the inputs in storage files that are missing, when the replay has come to them."""
        items = self._playlist.items
        counts = {items[topic].name: n for topic, n in bag.missing.items() if topic in items and items[topic].is_input}
        reasons = Counter({f"{name}: {IN_A_MISSING_FILE}": number for name, number in counts.items()})
        if reasons and not reasons.keys() & self.refused.keys():
            self.refused.update(reasons)
            self.get_logger().warning(f"{bag.missing_notice}: {reasons.total()} messages are not played")
            self.health.publish()  # a short rest of the bag may be played before the next period

    def _is_frame(self, message: RawMessage) -> bool:
        """Whether flow control counts the message: one on a frame topic that can be decoded."""
        item = self._playlist.items[message.topic]
        is_ours = item.type_name in BY_TYPE_NAME
        return item.is_frame and (not is_ours or is_usable(message.cdr, item.type_name))

    def _wait_while_paused(self) -> None:
        since_s = time.monotonic()
        while self._is_up and not self.is_active:
            time.sleep(0.05)
            self._pace.shift(time.monotonic() - since_s)
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
        """Whether to wait for the manager. Raises InputError if there was one and it is gone for ``GONE_S``."""
        if not self._is_up:
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
        frames = sum(bag.counts[topic] for topic in self._playlist.frames)
        return tqdm(total=frames, unit="frame", desc=self._bag.name, file=sys.stderr, dynamic_ncols=True)


class Pace:
    """Paces a replay at ``rate`` times real time; 0 never waits.

    The worker's thread waits; the rate may be changed on another thread.
    """

    def __init__(self, rate: float) -> None:
        self._rate = self._wanted_rate = rate
        self._last: tuple[int, float] | None = None  # log time of the last message, and when it was due

    def change(self, rate: float) -> None:
        """Use another rate from now on, also in a wait under way; called on any thread."""
        self._wanted_rate = rate

    def shift(self, by_s: float) -> None:
        """Postpone all further messages by ``by_s`` seconds."""
        if self._last is not None:
            self._last = self._last[0], self._last[1] + by_s

    def wait(self, stamp_ns: int) -> None:
        """Sleep until a message with this log time is due."""
        if self._rate <= 0.0:
            return
        if self._last is None:
            self._last = stamp_ns, time.monotonic()
        while (left_s := self._due(stamp_ns) - time.monotonic()) > 0.0:
            time.sleep(min(left_s, LONGEST_SLEEP_S))
            self._take_up_change(stamp_ns)
        self._last = stamp_ns, self._due(stamp_ns)
        self._take_up_change(stamp_ns)

    def _take_up_change(self, next_ns: int) -> None:
        """Have the wanted rate hold from the present place in the bag, which is at most the next message."""
        if self._wanted_rate == self._rate:
            return
        assert self._last is not None
        (before_ns, due), now = self._last, time.monotonic()
        self._last = min(before_ns + round((now - due) * self._rate * SECOND), next_ns), now
        self._rate = self._wanted_rate

    def _due(self, stamp_ns: int) -> float:
        assert self._last is not None
        before_ns, due = self._last
        return due + (stamp_ns - before_ns) / SECOND / self._rate


main = main_of(BagPlayer, __doc__ or "")
