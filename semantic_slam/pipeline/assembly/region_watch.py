"""Tells once, and early, that many detections lie outside the region that a configuration states."""

from typing import ClassVar

from semantic_slam.configuration import Configuration

MANY = 0.1
"""Share of the detections that edges and errors do not explain: at a tenth, the region is not that of the sensor."""
ENOUGH = 30
"""Detections from which on that share counts."""


class RegionWatch:
    """Counts detections, and those that a run does not use because they lie outside."""

    STATE: ClassVar[tuple[str, ...]] = ("_num_seen", "_num_outside", "_is_told", "_news")

    def __init__(self, configuration: Configuration) -> None:
        self._configuration = configuration
        self._num_seen = self._num_outside = 0
        self._is_told = False
        self._news: list[str] = []

    def count(self, seen: int, outside: int) -> None:
        """Count the detections of a frame."""
        self._num_seen += seen
        self._num_outside += outside
        if self._is_told or self._num_seen < ENOUGH or self._num_outside < MANY * self._num_seen:
            return
        self._is_told = True
        where, remedy = self._words
        self._news.append(
            f"{self._num_outside} of the first {self._num_seen} detections lie {where}, and are not used; {remedy}"
            " (semantic_slam doctor has the numbers)"
        )

    @property
    def _words(self) -> tuple[str, str]:
        """Where they lie, and what to do."""
        stated, remedy = "outside of the region that open_world states", "state the region of the sensor"
        if self._configuration.is_spatial:
            return stated, remedy
        if self._configuration.open_world.learn_region:
            return "beyond open_world.learn_region_within_m", "raise it if they are of things, and not of a far wall"
        if self._configuration.open_world.detection_by_direction:
            return stated, remedy
        return stated, f"set open_world.learn_region: true and learn_region_within_m, or {remedy}"

    def news(self) -> list[str]:
        """The line, once."""
        told, self._news = self._news, []
        return told
