"""Assignment of a run's objects to slots of the page's list."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.report.shown.objects import object_label

SHOWN_OBJECTS = 400
"""The likeliest to exist; a map of more is not to be read."""


class ShownObjects:
    """Places of objects in the page's list; that of a removed object is given away once no keyframe shows it."""

    def __init__(self) -> None:
        self.places: dict[int, int] = {}  # by id, of those of the newest belief
        self.written: dict[int, Array] = {}  # by id, what the page knows
        self._entries: list[tuple[int, dict[str, Any]]] = []  # version and entry by place
        self._free: list[int] = []

    def note(self, belief: HybridBelief, version: int) -> list[int]:
        """Take in who is there; returns the places of those that are not any more."""
        existence = np.where(np.isfinite(belief.existence), belief.existence, 1.0)
        rows = sorted(np.argsort(-existence, kind="stable")[:SHOWN_OBJECTS].tolist())
        shown = {int(belief.object_ids[row]): row for row in rows}
        gone = [self.places.pop(number) for number in list(self.places) if number not in shown]
        self.written = {number: state for number, state in self.written.items() if number in shown}
        for number, row in shown.items():
            if number not in self.places:
                self._enter(number, object_label(belief, row), version)
        return gone

    def changed_since(self, version: int) -> list[list[Any]]:
        """Place and entry of those that came into the list since."""
        return [[place, entry] for place, (since, entry) in enumerate(self._entries) if since > version]

    def free(self, places: Iterable[int]) -> None:
        """Nothing shows what stands at these places any more."""
        self._free += places

    def _enter(self, number: int, label: str, version: int) -> None:
        entry = {"label": label, "id": number, "true": None}
        if self._free:
            self.places[number] = self._free.pop()
            self._entries[self.places[number]] = (version, entry)
        else:
            self.places[number] = len(self._entries)
            self._entries.append((version, entry))
