"""Node diagnostics as listed on the page."""

import time
from typing import Any

from semantic_slam.messages.node_status import is_ours

KEPT_STATUSES = 200
SILENT_S = 5.0
"""Diagnostics come once a second; what has not spoken for so long is silent."""
FORGOTTEN_S = 600.0
MOST_LETTERS = 300
DROPPED = "dropped: "


class NodeHealth:
    """The newest status of each part of each node of one robot; others' diagnostics are not looked at."""

    def __init__(self, namespace: str) -> None:
        self._namespace = namespace
        self._statuses: dict[str, tuple[float, Any]] = {}  # when it came, by name

    def add(self, message: Any) -> None:
        """Take in a diagnostic_msgs/DiagnosticArray."""
        now_s = time.monotonic()
        for status in message.status:
            is_kept = status.name in self._statuses or len(self._statuses) < KEPT_STATUSES
            if is_kept and is_ours(status, self._namespace):
                self._statuses[str(status.name)] = now_s, status
        self._statuses = {name: own for name, own in self._statuses.items() if now_s - own[0] < FORGOTTEN_S}

    def rows(self) -> list[dict[str, Any]]:
        """The worst first."""
        now_s = time.monotonic()
        rows = [
            {
                "name": name,
                "level": int(status.level),
                "message": str(status.message)[:MOST_LETTERS],
                "silent": round(now_s - came_s) if now_s - came_s > SILENT_S else None,
            }
            for name, (came_s, status) in self._statuses.items()
        ]
        return sorted(rows, key=lambda row: (row["silent"] is not None, -row["level"], row["name"]))

    def dropped(self) -> list[list[str]]:
        """Node, reason and number of what was not used."""
        rows = sorted(
            [name.split(":")[0], value.key.removeprefix(DROPPED), str(value.value)]
            for name, (_, status) in self._statuses.items()
            for value in status.values
            if value.key.startswith(DROPPED)
        )
        return rows[:KEPT_STATUSES]
