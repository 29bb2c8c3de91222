"""Which stamps of one topic are believed: its clock runs forward, and a leap ahead needs two more witnesses."""

from collections import Counter, deque
from typing import Generic, TypeVar

from semantic_slam.messages.standard import NANOSECONDS

T = TypeVar("T")

LEAP_STEPS = 4
"""A step of more than so many of the topic's usual ones is a leap."""
USUAL_STEPS = 3
"""The shortest of so many last steps is usual: to suspect too much costs nothing but two messages' patience."""
WITNESSES = 2
"""So many messages that go on from a stamp confirm it."""
FIRST_STEP_NS = NANOSECONDS
"""How long the first step may be, before which there is none to compare it with."""
BACKWARDS = "time goes backwards"
AHEAD = "stamp leaps ahead of those around it"
SET_BACK = "its clock was set back; what follows is another session, to be run by itself"
ABOUT_THE_START_NS = 2 * NANOSECONDS
"""A session that is played again begins no later after the start of this one: its first messages may be lost."""
MOST_EARLIER = 5000
"""So many of the newest messages of another session are kept until it begins."""


class TopicClock(Generic[T]):
    """Gives out the items of one topic in the order of their stamps, and counts those that it refuses.

    Items whose stamps leap ahead are held aside until ``WITNESSES`` more go on from there: then there was a gap, and
    all are given out. When one goes on from the old time before that, those that are ahead of it were wrong stamps,
    and are dropped. So a clock that ran wrong once or twice costs those messages, and a topic without wrong stamps
    loses none. The first one or two have none before them: they are given out at once, and withdrawn when more than so
    many after them agree on an earlier time. Where several agree on an earlier time later on, that is named: a clock
    was set back. What is believed depends on the stamps alone, never on when they came.
    """

    def __init__(self, topic: str, dropped: Counter[str], most_earlier: int = MOST_EARLIER) -> None:
        self.topic = topic
        self._dropped = dropped
        self._first_ns: list[int] | None = []  # what is believed without witnesses; None: there are enough by now
        self._last_ns: int | None = None  # the newest stamp that is believed
        self._earlier_from_ns = 0  # the first stamp of all that agree, of which the newest are kept
        self._began_ns: int | None = None  # the first stamp that is believed
        self._steps_ns: deque[int] = deque(maxlen=USUAL_STEPS)  # between the newest that are believed
        self._held: list[tuple[int, T]] = []  # ahead of the newest, growing
        self._earlier: deque[tuple[int, T]] = deque(maxlen=most_earlier)  # the last ones that agree on an earlier time
        self.withdrawn_from_ns: int | None = None  # the last call withdraws what was given out from this stamp on

    @property
    def is_holding(self) -> bool:
        """Whether an item waits for the next ones."""
        return bool(self._held)

    @property
    def is_set_back(self) -> bool:
        """Whether several items, none newer after them, agree on an earlier time."""
        return len(self._earlier) > WITNESSES

    @property
    def begins_again(self) -> bool:
        """Whether it was set back to about the start of this session, or before it.

        Its items are of another session. Those that are earlier, but of this session's time, are of a player that was
        started again and goes over its last messages once more.
        """
        began_ns = self._began_ns
        return self.is_set_back and began_ns is not None and self._earlier_from_ns <= began_ns + ABOUT_THE_START_NS

    @property
    def earlier(self) -> list[tuple[int, T]]:
        """The newest items, one after the other, that agree on an earlier time; they were counted as dropped."""
        return list(self._earlier)

    def take(self, stamp_ns: int, item: T) -> list[tuple[int, T]]:
        """What is believed now that this item has come: nothing, it, or what was held and it."""
        self.withdrawn_from_ns = None
        if stamp_ns == self._last_ns or any(stamp_ns == held for held, _ in self._held):
            self._count("stamp repeats", 1)
            return []
        if self._last_ns is not None and stamp_ns < self._last_ns:
            return self._refuse(stamp_ns, item)
        self._earlier.clear()
        self._drop_held_after(stamp_ns)
        if self._held or self._is_leap(stamp_ns):
            self._held.append((stamp_ns, item))
            return self.release() if len(self._held) > WITNESSES else []
        self._advance(stamp_ns)
        return [(stamp_ns, item)]

    def release(self) -> list[tuple[int, T]]:
        """What is still held once no more will come: nothing has spoken against it, so it is believed."""
        held, self._held = self._held, []
        for stamp_ns, _ in held:
            self._advance(stamp_ns)
        return held

    def _refuse(self, stamp_ns: int, item: T) -> list[tuple[int, T]]:
        """Count an item that is too early; what is believed when those before it were the wrong ones."""
        if self._earlier and stamp_ns <= self._earlier[-1][0]:
            self._earlier.clear()
        if not self._earlier:
            self._earlier_from_ns = stamp_ns
        self._earlier.append((stamp_ns, item))
        agreeing = len(self._earlier)
        if self._first_ns and agreeing > len(self._first_ns):
            return self._begin_anew(self._first_ns)
        if agreeing <= WITNESSES:
            self._count(BACKWARDS, 1)
            return []
        if agreeing == WITNESSES + 1:  # those before were counted as stragglers
            self._count(BACKWARDS, -WITNESSES)
            self._count(SET_BACK, WITNESSES)
        self._count(SET_BACK, 1)
        return []

    def _begin_anew(self, first_ns: list[int]) -> list[tuple[int, T]]:
        """What is believed instead of the first items, which had wrong stamps."""
        taken = self.earlier
        self._earlier.clear()
        self.withdrawn_from_ns = taken[0][0]
        right = [stamp_ns for stamp_ns in first_ns if stamp_ns < taken[0][0]]
        self._count(BACKWARDS, 1 - len(taken))
        self._count(AHEAD, len(first_ns) - len(right) + len(self._held))
        self._first_ns, self._last_ns, self._began_ns, self._held = [], None, None, []
        self._steps_ns.clear()
        for stamp_ns in [*right, *(stamp for stamp, _ in taken)]:
            self._advance(stamp_ns)
        return taken

    def _drop_held_after(self, stamp_ns: int) -> None:
        wrong = [held for held in self._held if held[0] > stamp_ns]
        self._count(AHEAD, len(wrong))
        self._held = [held for held in self._held if held[0] <= stamp_ns]

    def _count(self, reason: str, number: int) -> None:
        name = f"{self.topic}: {reason}"
        self._dropped[name] += number
        if not self._dropped[name]:  # no reason that counts none
            del self._dropped[name]

    def _is_leap(self, stamp_ns: int) -> bool:
        if self._last_ns is None:
            return False
        most = LEAP_STEPS * min(self._steps_ns) if self._steps_ns else FIRST_STEP_NS
        return stamp_ns - self._last_ns > most

    def _advance(self, stamp_ns: int) -> None:
        if self._last_ns is not None:
            self._steps_ns.append(stamp_ns - self._last_ns)
        self._last_ns = stamp_ns
        self._began_ns = stamp_ns if self._began_ns is None else self._began_ns
        if self._first_ns is not None:
            self._first_ns.append(stamp_ns)
            if len(self._first_ns) > WITNESSES:
                self._first_ns = None
