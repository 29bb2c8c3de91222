"""Topic of the belief, on which a restarted manager tells its first beliefs again to readers that DDS matches later.

A live topic has no history: what is published before DDS has matched a reader with the publisher is lost to it, and on
a busy machine that takes seconds. Subscribers recognise a belief that they have by its keyframe.
"""

import time
from collections import deque
from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from semantic_slam.inference.belief import HybridBelief
from semantic_slam.messages.codec import encode
from semantic_slam.ros.wire.transport import Outlet

WINDOW_S = 60.0
"""How long after a restart readers are expected that were there before it."""
MOST = 200
"""Beliefs that are kept in this time, the newest."""
LOOK_S = 0.25
"""Period [s] of looking for other readers."""


class RetoldBeliefs:
    """Publishes beliefs on the worker's thread; those since a restart again, in order, when there is another reader."""

    def __init__(self, node: Node, outlet: Outlet, frame_id: str) -> None:
        self._node, self._outlet, self._frame_id = node, outlet, frame_id
        self._kept: deque[tuple[int, bytes]] = deque(maxlen=MOST)  # keyframe index, message
        self._keeps, self._num_readers = False, 0

    def send(self, belief: HybridBelief) -> None:
        """Publish a belief; before it, to readers that are new, those that are kept."""
        self._tell_again()
        data = encode(belief, frame_id=self._frame_id)
        if self._keeps:
            self._kept.append((belief.keyframe, data))
        self._outlet.send(data)

    def go_on(self, belief: HybridBelief | None, submit: Callable[[Callable[[Any], None], Any], None]) -> None:
        """Publish the newest belief before a restart again, if there is one, and keep what comes.

        ``submit`` queues for the worker. A reader that another one replaces within ``LOOK_S`` is not noticed.
        """
        self._keeps, self._num_readers = True, self._outlet.num_readers
        if belief is not None:
            self.send(belief)
        until_s = time.monotonic() + WINDOW_S

        def look() -> None:
            if time.monotonic() > until_s:
                self._node.destroy_timer(timer)
                submit(self._end, None)
            elif self._outlet.num_readers != self._num_readers:
                submit(self._tell_again, None)

        timer = self._node.create_timer(LOOK_S, look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def forget(self) -> None:
        """Keep nothing of the run that has ended."""
        self._kept.clear()

    def wait_for_acknowledgement(self) -> None:
        """Wait until all readers have acknowledged everything."""
        self._outlet.wait_for_acknowledgement()

    def _end(self, _: None) -> None:
        self._keeps = False
        self._kept.clear()

    def _tell_again(self, _: None = None) -> None:
        before, self._num_readers = self._num_readers, self._outlet.num_readers
        if self._num_readers <= before or not self._kept:
            return
        first, last = self._kept[0][0], self._kept[-1][0]
        which = f"keyframe {first} is" if first == last else f"keyframes {first} to {last} are"
        self._node.get_logger().info(f"{self._outlet.name} has another reader: {which} published again")
        for _keyframe, data in self._kept:
            self._outlet.send(data)
