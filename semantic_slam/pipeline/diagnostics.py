"""Diagnostics message with the counts of dropped inputs."""

from collections import Counter
from collections.abc import Mapping
from typing import Any

from semantic_slam.messages.node_status import HARDWARE_ID
from semantic_slam.messages.standard import header_message
from semantic_slam.messages.typestore import message_class

OK, WARNING = 0, 1


def dropped_message(stamp_ns: int, dropped_by: Mapping[str, Counter[str]]) -> Any:
    """diagnostic_msgs/DiagnosticArray, one status per part of the pipeline: key ``dropped: reason``, value count."""
    key_value = message_class("diagnostic_msgs/msg/KeyValue")
    statuses = [
        message_class("diagnostic_msgs/msg/DiagnosticStatus")(
            level=WARNING if dropped else OK,
            name=f"semantic_slam: {part}",
            message=f"{dropped.total()} dropped" if dropped else "nothing dropped",
            hardware_id=HARDWARE_ID,
            values=[key_value(key=f"dropped: {reason}", value=str(n)) for reason, n in sorted(dropped.items())],
        )
        for part, dropped in dropped_by.items()
    ]
    return message_class("diagnostic_msgs/msg/DiagnosticArray")(header=header_message(stamp_ns, ""), status=statuses)
