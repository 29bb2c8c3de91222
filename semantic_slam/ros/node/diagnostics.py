"""Publishes a node's health on /diagnostics, once a second."""

import math
import time
from collections.abc import Callable, Iterable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from semantic_slam.messages.node_status import HARDWARE_ID, status_name
from semantic_slam.messages.standard import header_message
from semantic_slam.messages.topics import DIAGNOSTICS, TYPES
from semantic_slam.messages.typestore import message_class, serialize
from semantic_slam.ros.node.health import InputMonitor, Level, Status, console_text, incompatible_status
from semantic_slam.ros.wire.qos import everything
from semantic_slam.ros.wire.transport import Outlet

PERIOD_S = 1.0
SAY_AGAIN_S = 10.0
"""Minimum interval between console lines about the node's health."""


class Diagnostics:
    """Collects the statuses of one node and publishes them on /diagnostics."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._outlet = Outlet(node, DIAGNOSTICS, TYPES[DIAGNOSTICS], everything())
        self._monitors: list[InputMonitor] = []
        self._incompatible: dict[str, Status] = {}
        self._sources: list[Callable[[], Iterable[Status]]] = []
        self.speaks = False  # whether to print to the console
        self._said, self._said_s = "", -math.inf
        self.finished = False  # a replay has ended: silent inputs are no problem
        # The steady clock, so that diagnostics are published also while simulated time stands still.
        node.create_timer(PERIOD_S, self.publish, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def monitor(self, topic: str) -> InputMonitor:
        """Monitor a required input topic; its callback has to call ``arrived``."""
        self._monitors.append(InputMonitor(topic, time.monotonic()))
        return self._monitors[-1]

    def forget(self, monitor: InputMonitor) -> None:
        """Stop monitoring an input."""
        self._monitors.remove(monitor)

    def add_source(self, source: Callable[[], Iterable[Status]]) -> None:
        self._sources.append(source)

    def incompatible(self, topic: str, policy: str) -> None:
        """Report a publisher whose QoS is incompatible with our subscription."""
        self._incompatible[topic] = incompatible_status(topic, policy)

    def publish(self) -> None:
        statuses = list(self._incompatible.values())
        if not self.finished:
            statuses += [self._input_status(monitor) for monitor in self._monitors]
        for source in self._sources:
            statuses += source()
        if not statuses:
            statuses = [Status("node", Level.OK, "running")]
        self._say(statuses)
        self._outlet.send(serialize(self._message(statuses)))

    def _say(self, statuses: list[Status]) -> None:
        """Print problems and missing inputs to the console when they change, at most once in ten seconds."""
        text = console_text(statuses)
        if not self.speaks or text == self._said or time.monotonic() - self._said_s < SAY_AGAIN_S:
            return
        self._said, self._said_s = text, time.monotonic()
        self._node.get_logger().info(text or "all inputs are there")

    def _input_status(self, monitor: InputMonitor) -> Status:
        publishers = sum(self._node.count_publishers(name) for name in monitor.topic.split(" or "))
        return monitor.status(time.monotonic(), publishers)

    def _message(self, statuses: list[Status]) -> Any:
        return message_class(TYPES[DIAGNOSTICS])(
            header=header_message(self._node.get_clock().now().nanoseconds, ""),
            status=[self._status_message(status) for status in statuses],
        )

    def _status_message(self, status: Status) -> Any:
        key_value = message_class("diagnostic_msgs/msg/KeyValue")
        return message_class("diagnostic_msgs/msg/DiagnosticStatus")(
            level=int(status.level),
            name=status_name(self._node.get_fully_qualified_name(), status.name),
            message=status.message,
            hardware_id=HARDWARE_ID,
            values=[key_value(key=key, value=value) for key, value in status.values.items()],
        )
