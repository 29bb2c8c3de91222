"""Naming of our nodes' statuses on /diagnostics, which all robots of a ROS domain share."""

from collections.abc import Iterable
from typing import Any

HARDWARE_ID = "semantic_slam"
"""Hardware id of all diagnostic statuses of our nodes."""


CARRIED_IN = "carried in keyframes"
"""Key of the value that names the keyframes in which the robot was taken for carried elsewhere."""


def status_name(node: str, part: str) -> str:
    """Status name, such as ``robot1/classifier: input /robot1/odom`` for a part of ``/robot1/classifier``."""
    return f"{node.lstrip('/')}: {part}"


def is_ours(status: Any, namespace: str) -> bool:
    """Whether a diagnostic_msgs/DiagnosticStatus comes from one of our nodes in this namespace."""
    return status.hardware_id == HARDWARE_ID and namespace_of(status) == namespace


def namespace_of(status: Any) -> str:
    """Namespace of the node that sent one of our statuses."""
    return "/" + str(status.name).partition(":")[0].rpartition("/")[0]


def is_of_another_robot(statuses: Iterable[Any], namespace: str) -> bool:
    """Whether any status comes from one of our nodes in another namespace."""
    return any(status.hardware_id == HARDWARE_ID and namespace_of(status) != namespace for status in statuses)
