"""Buffer of the messages a recorder has received recently, for a new session whose first messages came unannounced."""

from collections import deque
from typing import NamedTuple

from semantic_slam.messages import topics
from semantic_slam.messages.standard import NANOSECONDS

MOST = 5000
EARLIER_NS = 2 * NANOSECONDS
"""How long before its first keyframe the inputs of a session may begin."""


class Received(NamedTuple):
    """One received message."""

    topic: str
    data: bytes
    stamp_ns: int  # header stamp


class RecentInputs:
    """The newest messages of the recorded topics, and the last one of each latched topic."""

    def __init__(self) -> None:
        self._latched: dict[str, Received] = {}
        self._recent: deque[Received] = deque(maxlen=MOST)

    def note(self, topic: str, data: bytes, stamp_ns: int) -> None:
        """Remember a message."""
        if topic in topics.LATCHED:
            self._latched[topic] = Received(topic, data, stamp_ns)
        elif topic in topics.KEPT_INPUTS or topic == topics.MEASUREMENTS:
            self._recent.append(Received(topic, data, stamp_ns))

    def of_session(self, first_stamp_ns: int) -> list[Received]:
        """Messages of the session whose first keyframe has this stamp: the latched ones, then in order of arrival.

        Per topic these are the newest messages with increasing stamps: where stamps jump back, the messages before
        belong to another session.
        """
        earliest: dict[str, int] = {}
        over: set[str] = set()
        found: list[Received] = []
        for item in reversed(self._recent):
            margin_ns = 0 if item.topic == topics.MEASUREMENTS else EARLIER_NS
            too_old = item.stamp_ns < first_stamp_ns - margin_ns
            if too_old or item.stamp_ns > earliest.get(item.topic, item.stamp_ns):
                over.add(item.topic)
            if item.topic not in over:
                earliest[item.topic] = item.stamp_ns
                found.append(item)
        return [*self._latched.values(), *reversed(found)]
