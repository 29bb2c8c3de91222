"""Serialised messages in and out: what travels is what ``messages.codec`` makes, byte for byte what lies in bags."""

import importlib
import time
from collections.abc import Callable, Collection
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSPolicyKind, QoSProfile

from semantic_slam.errors import InputError, SemanticSlamError
from semantic_slam.messages.topics import GLOBAL, TYPES

PATIENCE_S = 60.0
RETRY_S = 0.01
UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"
"""What DDS discovery calls a node between its endpoint's arrival and its own."""


def ros_type(type_name: str) -> Any:
    """The generated class of ``package/msg/Name``, for its type support. Raises InputError when it is not installed."""
    package, _, name = type_name.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        raise InputError(f"{type_name}: package {package} is not installed; install ros-jazzy-{package}") from None


def is_installed(type_name: str) -> bool:
    """Whether messages of this type can be published and received here."""
    try:
        ros_type(type_name)
    except InputError:
        return False
    return True


def private_name(topic: str) -> str:
    """``~/belief`` for ``/hypothesis_manager/belief``: the name under which its own node publishes it."""
    return "~/" + topic.rsplit("/", 1)[-1]


def relative_name(topic: str) -> str:
    """The name under which other nodes of the same namespace find a topic of ours; of some it is one for all."""
    return topic if topic in GLOBAL else topic.lstrip("/")


class Outlet:
    """A publisher of serialised messages."""

    def __init__(self, node: Node, name: str, type_name: str, qos: QoSProfile) -> None:
        self._node = node
        self._publisher = node.create_publisher(ros_type(type_name), name, qos)
        self.name: str = self._publisher.topic_name

    @property
    def num_readers(self) -> int:
        return int(self._publisher.get_subscription_count())

    def has_listener_besides(self, silent: Collection[str]) -> bool:
        """Whether a node not named in ``silent`` is matched; one whose name is not known yet does not count."""
        names = [reader.node_name for reader in self._node.get_subscriptions_info_by_topic(self.name)]
        others = [name for name in names if name not in (*silent, UNKNOWN_NODE)]
        return bool(others) and self.num_readers > sum(name in silent for name in names)

    def send(self, data: bytes) -> None:
        """Publish CDR bytes; waits while the readers are behind. Raises SemanticSlamError after a minute of that.

        A node that is being ended has nobody left to tell.
        """
        give_up = time.monotonic() + PATIENCE_S
        while True:
            try:
                self._publisher.publish(data)
                return
            except RuntimeError:  # the history is full: a reader takes nothing
                if not self._node.context.ok():
                    return
                if time.monotonic() > give_up:
                    raise SemanticSlamError(f"{self.name}: a reader has taken nothing for {PATIENCE_S:.0f} s") from None
                time.sleep(RETRY_S)

    def wait_for_readers(self, number: int, timeout_s: float) -> bool:
        """Whether at least ``number`` readers are matched before the timeout."""
        give_up = time.monotonic() + timeout_s
        while self.num_readers < number and time.monotonic() < give_up:
            time.sleep(0.02)
        return self.num_readers >= number

    def wait_for_acknowledgement(self) -> bool:
        """Whether every matched reader has received all that was sent, waiting a minute at most."""
        from rclpy.duration import Duration

        return bool(self._publisher.wait_for_all_acked(Duration(seconds=PATIENCE_S)))


def receive(
    node: Node,
    topic: str,
    callback: Callable[[bytes], None],
    qos: QoSProfile,
    type_name: str = "",
    on_incompatible: Callable[[str, str], None] | None = None,
) -> str:
    """Subscribe to serialised messages; returns the resolved topic name.

    ``on_incompatible`` receives the topic and the policy when a publisher's QoS can never match.
    """
    name: str = node.resolve_topic_name(relative_name(topic))

    def incompatible(event: Any) -> None:
        if on_incompatible is not None:
            on_incompatible(name, QoSPolicyKind(event.last_policy_kind).name)

    node.create_subscription(
        ros_type(type_name or TYPES[topic]),
        name,
        callback,
        qos,
        raw=True,
        event_callbacks=SubscriptionEventCallbacks(incompatible_qos=incompatible),
    )
    return name
