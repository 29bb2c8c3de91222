"""Which backends are alive, as DDS sees it: its own threads assert it, whatever the process is busy with."""

from collections.abc import Callable, Sequence
from typing import Any

from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy

from semantic_slam.ros.transport import ros_type

LEASE_S = 1.0
"""A process that was killed is missed after so long."""


class Sign:
    """A backend's sign of life: a publisher that says nothing, but is there."""

    def __init__(self, node: Node, backend_id: int) -> None:
        self._publisher = node.create_publisher(ros_type("std_msgs/msg/Empty"), _name(backend_id), _profile())


class Watch:
    """Calls ``gone`` with the id of a backend whose sign of life was there and ends."""

    def __init__(self, node: Node, backend_ids: Sequence[int], gone: Callable[[int], None]) -> None:
        self._subscriptions = [self._watch(node, number, gone) for number in backend_ids]

    @staticmethod
    def _watch(node: Node, backend_id: int, gone: Callable[[int], None]) -> Any:
        def changed(event: Any) -> None:
            if event.alive_count == 0 and (event.alive_count_change < 0 or event.not_alive_count_change > 0):
                gone(backend_id)

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
