"""Which stamps of one topic are believed: its clock runs forward, and a leap ahead needs a second witness."""

from collections import Counter, deque
from typing import Generic, TypeVar

from semantic_slam.messages.standard import NANOSECONDS

T = TypeVar("T")

LEAP_STEPS = 4
"""A step of more than so many of the topic's usual ones is a leap."""
USUAL_STEPS = 3
"""The shortest of so many last steps is usual: to suspect too much costs nothing but one message's patience."""
FIRST_STEP_NS = NANOSECONDS
"""How long the first step may be, before which there is none to compare it with."""
BACKWARDS = "time goes backwards"
AHEAD = "stamp leaps ahead of those around it"


class TopicClock(Generic[T]):
    """Gives out the items of one topic in the order of their stamps, and counts those that it refuses.

    An item whose stamp leaps ahead is held aside. The next one tells: when it goes on from the old time, the leap was
    one wrong stamp and is dropped; when it goes on from the new time, there was a gap and both are given out. So a
    clock that ran wrong once costs one message, and a topic without wrong stamps loses none. The very first item has
    none before it: it is given out at once, and withdrawn when the two after it agree on an earlier time. What is
    believed depends on the stamps alone, never on when they came.
    """

    def __init__(self, topic: str, dropped: Counter[str]) -> None:
        self.topic = topic
        self._dropped = dropped
        self._last_ns: int | None = None  # the newest stamp that is believed
        self._steps_ns: deque[int] = deque(maxlen=USUAL_STEPS)  # between the newest that are believed
        self._held: tuple[int, T] | None = None
        self._earlier: tuple[int, T] | None = None  # than the first one, of which nothing is known yet
        self.withdraws_first = False  # what the last call gave out stands instead of the very first item

    @property
    def is_holding(self) -> bool:
        """Whether an item waits for the next one."""
        return self._held is not None

    def take(self, stamp_ns: int, item: T) -> list[tuple[int, T]]:
        """What is believed now that this item has come: nothing, it, or what was held and it."""
        self.withdraws_first = self._first_is_wrong(stamp_ns)
        if self.withdraws_first:
            return self._begin_anew(stamp_ns, item)
        if self._is_old(stamp_ns):
            self._earlier = (stamp_ns, item)
            return []
        believed = self._judge_held(stamp_ns)
        if self._is_leap(stamp_ns):
            self._held = (stamp_ns, item)
            return believed
        self._advance(stamp_ns)
        return [*believed, (stamp_ns, item)]

    def release(self) -> list[tuple[int, T]]:
        """What is still held once no more will come: nothing has spoken against it, so it is believed."""
        return [] if self._held is None else self._believe_held()

    def _first_is_wrong(self, stamp_ns: int) -> bool:
        is_first = self._last_ns is not None and not self._steps_ns and self._held is None
        return is_first and self._earlier is not None and self._earlier[0] < stamp_ns < (self._last_ns or 0)

    def _begin_anew(self, stamp_ns: int, item: T) -> list[tuple[int, T]]:
        """What is believed now, with the item that was refused as too early, and this one."""
        assert self._earlier is not None
        self._dropped[f"{self.topic}: {BACKWARDS}"] -= 1
        self._dropped += Counter()  # without a reason that counts none
        self._dropped[f"{self.topic}: {AHEAD}"] += 1
        self._last_ns = None
        self._advance(self._earlier[0])
        self._advance(stamp_ns)
        return [self._earlier, (stamp_ns, item)]

    def _is_old(self, stamp_ns: int) -> bool:
        """Whether a stamp does not grow, which is counted."""
        known = [self._last_ns, self._held[0] if self._held else None]
        repeats = stamp_ns in known
        backwards = self._last_ns is not None and stamp_ns < self._last_ns
        if repeats or backwards:
            self._dropped[f"{self.topic}: {'stamp repeats' if repeats else BACKWARDS}"] += 1
        return repeats or backwards

    def _judge_held(self, stamp_ns: int) -> list[tuple[int, T]]:
        if self._held is None:
            return []
        if stamp_ns > self._held[0]:
            return self._believe_held()
        self._dropped[f"{self.topic}: {AHEAD}"] += 1
        self._held = None
        return []

    def _believe_held(self) -> list[tuple[int, T]]:
        assert self._held is not None
        held, self._held = self._held, None
        self._advance(held[0])
        return [held]

    def _is_leap(self, stamp_ns: int) -> bool:
        if self._last_ns is None:
            return False
        most = LEAP_STEPS * min(self._steps_ns) if self._steps_ns else FIRST_STEP_NS
        return stamp_ns - self._last_ns > most

    def _advance(self, stamp_ns: int) -> None:
        if self._last_ns is not None:
            self._steps_ns.append(stamp_ns - self._last_ns)
        self._last_ns = stamp_ns
