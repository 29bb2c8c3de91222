"""How our nodes name what they say of themselves on /diagnostics, which all robots of a ROS domain share."""

from collections.abc import Iterable
from typing import Any

HARDWARE_ID = "semantic_slam"
"""The hardware id of all statuses of our nodes."""


def status_name(node: str, part: str) -> str:
    """``robot1/classifier: input /robot1/odom`` for a part of ``/robot1/classifier``."""
    return f"{node.lstrip('/')}: {part}"


def is_ours(status: Any, namespace: str) -> bool:
    """Whether a diagnostic_msgs/DiagnosticStatus is of a node of ours in this namespace."""
    return status.hardware_id == HARDWARE_ID and namespace_of(status) == namespace


def namespace_of(status: Any) -> str:
    """The namespace of the node that a status of ours is of."""
    return "/" + str(status.name).partition(":")[0].rpartition("/")[0]


def is_of_another_robot(statuses: Iterable[Any], namespace: str) -> bool:
    """Whether statuses are of nodes of ours in another namespace."""
    return any(status.hardware_id == HARDWARE_ID and namespace_of(status) != namespace for status in statuses)
