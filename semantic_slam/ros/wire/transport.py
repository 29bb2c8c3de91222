"""Publishes and receives serialised messages: the CDR bytes of ``messages.codec``, identical to those in bags."""

import importlib
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.qos import QoSPolicyKind, QoSProfile
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions

from semantic_slam.errors import InputError, SemanticSlamError, one_line
from semantic_slam.messages.topics import GLOBAL, TYPES

PATIENCE_S = 60.0
LOOK_S = 0.1
RETRY_S = 0.01
OVERRIDES = QoSOverridingOptions(
    (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY)
)
"""QoS policies that parameters ``qos_overrides.*`` may change, for topics shared with other packages."""
UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"
"""Node name reported while DDS has discovered an endpoint but not its node yet."""


def ros_type(type_name: str) -> Any:
    """The generated class of ``package/msg/Name``, with its type support. Raises InputError if it is not installed."""
    package, _, name = type_name.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        debian = f"ros-jazzy-{package.replace('_', '-')}"
        raise InputError(f"{type_name}: package {package} is not installed; install {debian}") from None


def is_installed(type_name: str) -> bool:
    """Whether the package of this message type is installed."""
    try:
        ros_type(type_name)
    except InputError:
        return False
    return True


def private_name(topic: str) -> str:
    """Private name under which a topic's own node publishes it: ``~/belief`` for ``/hypothesis_manager/belief``."""
    return "~/" + topic.rsplit("/", 1)[-1]


def relative_name(topic: str) -> str:
    """Name of one of our topics relative to the namespace; topics in ``GLOBAL`` keep their absolute name."""
    return topic if topic in GLOBAL else topic.lstrip("/")


class Outlet:
    """A publisher of serialised messages."""

    def __init__(
        self, node: Node, name: str, type_name: str, qos: QoSProfile, *, may_be_overridden: bool = False
    ) -> None:
        """``may_be_overridden``: parameters ``qos_overrides.<topic>.publisher.*`` change ``qos``. Raises InputError."""
        self._node = node
        with _named_overrides(node):
            overrides = OVERRIDES if may_be_overridden else None
            self._publisher = node.create_publisher(ros_type(type_name), name, qos, qos_overriding_options=overrides)
        self.name: str = self._publisher.topic_name

    @property
    def num_readers(self) -> int:
        return int(self._publisher.get_subscription_count())

    def has_listener_besides(self, silent: Collection[str]) -> bool:
        """Whether a subscription of a node not in ``silent`` is matched; nodes not yet discovered do not count."""
        names = [reader.node_name for reader in self._node.get_subscriptions_info_by_topic(self.name)]
        others = [name for name in names if name not in (*silent, UNKNOWN_NODE)]
        return bool(others) and self.num_readers > sum(name in silent for name in names)

    def send(self, data: bytes) -> None:
        """Publish CDR bytes; blocks while the history is full. Raises SemanticSlamError after ``PATIENCE_S``.

        Returns without publishing if the node is shutting down.
        """
        give_up = time.monotonic() + PATIENCE_S
        while True:
            try:
                self._publisher.publish(data)
                return
            except RuntimeError:  # the writer's history is full: a reader does not acknowledge
                if not self._node.context.ok():
                    return
                if time.monotonic() > give_up:
                    raise SemanticSlamError(f"{self.name}: a reader has taken nothing for {PATIENCE_S:.0f} s") from None
                time.sleep(RETRY_S)

    def wait_for_readers(self, number: int, timeout_s: float) -> bool:
        """Wait until ``number`` readers are matched; returns False on timeout."""
        give_up = time.monotonic() + timeout_s
        while self.num_readers < number and time.monotonic() < give_up:
            time.sleep(0.02)
        return self.num_readers >= number

    def wait_for_acknowledgement(self) -> bool:
        """Wait until all matched readers have acknowledged everything; returns False after ``PATIENCE_S``.

        So it does once rclpy is shut down: a reader that was killed acknowledges nothing.
        """
        from rclpy.duration import Duration

        give_up = time.monotonic() + PATIENCE_S
        while self._node.context.ok() and time.monotonic() < give_up:
            if self._publisher.wait_for_all_acked(Duration(seconds=LOOK_S)):
                return True
        return False


def receive(
    node: Node,
    topic: str,
    callback: Callable[[bytes], None],
    qos: QoSProfile,
    type_name: str = "",
    on_incompatible: Callable[[str, str], None] | None = None,
    *,
    may_be_overridden: bool = False,
) -> str:
    """Subscribe to serialised messages of a topic; returns its resolved name.

    ``on_incompatible`` is called with topic and policy name if a publisher's QoS is incompatible.
    """
    name: str = node.resolve_topic_name(relative_name(topic))

    def incompatible(event: Any) -> None:
        if on_incompatible is not None:
            on_incompatible(name, QoSPolicyKind(event.last_policy_kind).name)

    with _named_overrides(node):
        node.create_subscription(
            ros_type(type_name or TYPES[topic]),
            name,
            callback,
            qos,
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(incompatible_qos=incompatible),
            qos_overriding_options=OVERRIDES if may_be_overridden else None,
        )
    return name


@contextmanager
def _named_overrides(node: Node) -> Iterator[None]:
    """Turn rclpy's errors on QoS overrides into InputError; for a wrong value rclpy raises RuntimeError."""
    try:
        yield
    except (InvalidQosOverridesError, InvalidParameterTypeException, InvalidParameterValueException, RuntimeError) as f:
        text = one_line(f)
        if type(f) is RuntimeError and "QoS override" not in text:
            raise
        raise InputError(
            f"parameters of {node.get_name()}: a qos_overrides is wrong ({text}); see docs/ros.md"
        ) from None
