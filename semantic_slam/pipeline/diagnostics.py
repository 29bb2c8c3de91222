"""Diagnostics message of a whole run: the counts of dropped inputs, and when the robot was taken for carried."""

from collections import Counter
from collections.abc import Mapping
from typing import Any

from semantic_slam.inference.relocation.carried_spans import Spans, spans_text
from semantic_slam.messages.node_status import CARRIED_IN, HARDWARE_ID
from semantic_slam.messages.standard import header_message
from semantic_slam.messages.typestore import message_class

OK, WARNING = 0, 1


def dropped_message(stamp_ns: int, dropped_by: Mapping[str, Counter[str]], carried: Spans = ()) -> Any:
    """diagnostic_msgs/DiagnosticArray, one status per part of the pipeline: key ``dropped: reason``, value count.

    One more status where the robot was taken for ``carried`` elsewhere, with these keyframes.
    """
    statuses = [
        _status(
            part,
            f"{dropped.total()} dropped" if dropped else "nothing dropped",
            {f"dropped: {reason}": str(n) for reason, n in sorted(dropped.items())},
        )
        for part, dropped in dropped_by.items()
    ]
    if carried:
        statuses.append(_status("carried", "the robot was taken for carried", {CARRIED_IN: spans_text(carried)}))
    return message_class("diagnostic_msgs/msg/DiagnosticArray")(header=header_message(stamp_ns, ""), status=statuses)


def _status(part: str, text: str, values: Mapping[str, str]) -> Any:
    """diagnostic_msgs/DiagnosticStatus, a warning where there are any values."""
    key_value = message_class("diagnostic_msgs/msg/KeyValue")
    return message_class("diagnostic_msgs/msg/DiagnosticStatus")(
        level=WARNING if values else OK,
        name=f"semantic_slam: {part}",
        message=text,
        hardware_id=HARDWARE_ID,
        values=[key_value(key=key, value=value) for key, value in values.items()],
    )
