"""What a recorder has received lately, for another session that has begun with it before anybody could say so."""

from collections import deque
from typing import NamedTuple

from semantic_slam.messages import topics
from semantic_slam.messages.standard import NANOSECONDS

MOST = 5000
EARLIER_NS = 2 * NANOSECONDS
"""A session's inputs may begin so long before its first keyframe."""


class Received(NamedTuple):
    """One message."""

    topic: str
    data: bytes
    stamp_ns: int  # of its header


class RecentInputs:
    """The newest messages of the topics that a belief bag keeps, and of latched ones the last."""

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
        """What belongs to a session whose first keyframe has this stamp, in the order in which it came.

        Of each topic that is the newest stretch of growing stamps: where the clock was set back, what was before that
        is of another session.
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
