"""Liveliness of backends by DDS, whose own threads assert it however busy the process is."""

import time
from collections.abc import Sequence
from typing import Any

from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy

from semantic_slam.ros.wire.transport import ros_type

LEASE_S = 1.0
"""Liveliness lease duration: a killed process is noticed after this time."""


class Sign:
    """A backend's liveliness publisher; it sends no messages."""

    def __init__(self, node: Node, backend_id: int) -> None:
        self._publisher = node.create_publisher(ros_type("std_msgs/msg/Empty"), _name(backend_id), _profile())


class Watch:
    """Tracks for how long the liveliness of each backend has been lost."""

    def __init__(self, node: Node, backend_ids: Sequence[int]) -> None:
        self._missing_since: dict[int, float] = {}
        self._seen: set[int] = set()
        self._several_since: dict[int, float] = {}
        self._subscriptions = [self._watch(node, number) for number in backend_ids]

    def was_seen(self, backend_id: int) -> bool:
        """Whether the backend has ever been alive."""
        return backend_id in self._seen

    def missing_s(self, backend_id: int) -> float:
        """Seconds since liveliness was lost; 0 while the backend is alive and before it was first seen."""
        since = self._missing_since.get(backend_id)
        return 0.0 if since is None else time.monotonic() - since

    def is_alive(self, backend_id: int) -> bool:
        """Whether the backend is alive now."""
        return self.was_seen(backend_id) and backend_id not in self._missing_since

    def several_s(self, backend_id: int) -> float:
        """Seconds for which several nodes have been alive under this id; 0 while there is at most one."""
        since = self._several_since.get(backend_id)
        return 0.0 if since is None else time.monotonic() - since

    def _watch(self, node: Node, backend_id: int) -> Any:
        def changed(event: Any) -> None:
            if event.alive_count > 0:
                self._seen.add(backend_id)
                self._missing_since.pop(backend_id, None)
            elif event.alive_count_change < 0 or event.not_alive_count_change > 0:
                self._missing_since.setdefault(backend_id, time.monotonic())
            if event.alive_count > 1:
                self._several_since.setdefault(backend_id, time.monotonic())
            else:
                self._several_since.pop(backend_id, None)

        return node.create_subscription(
            ros_type("std_msgs/msg/Empty"),
            _name(backend_id),
            lambda _: None,
            _profile(),
            event_callbacks=SubscriptionEventCallbacks(liveliness=changed),
        )


def _name(backend_id: int) -> str:
    return f"backend_{backend_id}/alive"


def _profile() -> QoSProfile:
    return QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE,
        history=HistoryPolicy.KEEP_LAST,
        depth=1,
        liveliness=LivelinessPolicy.AUTOMATIC,
        liveliness_lease_duration=Duration(seconds=LEASE_S),
    )
