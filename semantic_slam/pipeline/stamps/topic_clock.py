"""Validates the stamps of one topic: its clock must run forward, and a leap ahead needs two confirming messages."""

from collections import Counter, deque
from typing import ClassVar, Generic, TypeVar

from semantic_slam.messages.standard import NANOSECONDS

T = TypeVar("T")

LEAP_STEPS = 4
"""A step longer than this many usual steps is a leap."""
USUAL_STEPS = 3
"""The usual step is the shortest of this many last ones; a needless suspicion only delays by two messages."""
WITNESSES = 2
"""Number of later messages, continuing from a stamp, that confirm it."""
FIRST_STEP_NS = NANOSECONDS
"""Longest first step that is no leap, as there is no earlier one to compare it with."""
BACKWARDS = "time goes backwards"
AHEAD = "stamp leaps ahead of those around it"
SET_BACK = "its clock was set back; what follows is another session, to be run by itself"
ABOUT_THE_START_NS = 2 * NANOSECONDS
"""A replayed session begins at most this long after the start of the current one; its first messages may be lost."""
MOST_EARLIER = 5000
"""Maximum number of messages of another session kept until it begins; the newest ones."""


class TopicClock(Generic[T]):
    """Releases the items of one topic in stamp order; refused ones are counted.

    Items whose stamps leap ahead are put on hold until ``WITNESSES`` more continue from there: then it was a gap, and
    all are released. If one continues from the old time before that, the stamps ahead of it were wrong, and those items
    are dropped. So one or two wrong stamps cost only those messages, and a topic without wrong stamps loses none. The
    first one or two items have no predecessors to compare with: they are released at once, and withdrawn if a larger
    number of later items agree on an earlier time, unless :meth:`settle` was called. If several items agree on an
    earlier time later in the run, they are counted as a clock that was set back. The result depends on the stamps
    alone, never on arrival times.
    """

    STATE: ClassVar[tuple[str, ...]] = (
        "_first_ns",
        "_last_ns",
        "_earlier_from_ns",
        "_began_ns",
        "_steps_ns",
        "_held",
        "_earlier",
        "withdrawn_from_ns",
    )

    def __init__(self, topic: str, dropped: Counter[str], most_earlier: int = MOST_EARLIER) -> None:
        self.topic = topic
        self._dropped = dropped
        self._first_ns: list[int] | None = []  # first stamps, accepted without confirmation; None once there are enough
        self._last_ns: int | None = None  # the newest accepted stamp
        self._earlier_from_ns = 0  # the first stamp of the series in _earlier, which may no longer be kept
        self._began_ns: int | None = None  # the first accepted stamp
        self._steps_ns: deque[int] = deque(maxlen=USUAL_STEPS)  # between the newest accepted stamps
        self._held: list[tuple[int, T]] = []  # on hold: ahead of the newest, with increasing stamps
        self._earlier: deque[tuple[int, T]] = deque(maxlen=most_earlier)  # the newest that agree on an earlier time
        self.withdrawn_from_ns: int | None = None  # set if the last call to take withdraws items from this stamp on

    @property
    def is_settled(self) -> bool:
        """Whether no item that was accepted can be withdrawn any more."""
        return self._first_ns is None

    def settle(self) -> None:
        """Withdraw no item from now on, as the first ones are in use; an earlier time is another session."""
        self._first_ns = None

    @property
    def is_holding(self) -> bool:
        """Whether an item is on hold until the next ones confirm or refute its stamp."""
        return bool(self._held)

    @property
    def is_set_back(self) -> bool:
        """Whether several consecutive last items agree on an earlier time."""
        return len(self._earlier) > WITNESSES

    @property
    def begins_again(self) -> bool:
        """Whether the clock was set back to about the start of this session, or before it.

        Then its items belong to another session. Earlier items within this session's time come from a restarted player
        that repeats its last messages.
        """
        began_ns = self._began_ns
        return self.is_set_back and began_ns is not None and self._earlier_from_ns <= began_ns + ABOUT_THE_START_NS

    @property
    def earlier(self) -> list[tuple[int, T]]:
        """The newest items, in order, that agree on an earlier time; they were counted as dropped."""
        return list(self._earlier)

    def take(self, stamp_ns: int, item: T) -> list[tuple[int, T]]:
        """Take an item; returns the items accepted by now: none, the item, or the items on hold and it."""
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
        """Accept and return the items on hold, as no more will come and nothing has refuted them."""
        held, self._held = self._held, []
        for stamp_ns, _ in held:
            self._advance(stamp_ns)
        return held

    def _refuse(self, stamp_ns: int, item: T) -> list[tuple[int, T]]:
        """Refuse and count an item that is too early; returns items if those accepted before it were wrong instead."""
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
        if agreeing == WITNESSES + 1:  # recount the ones before, which were counted as stragglers
            self._count(BACKWARDS, -WITNESSES)
            self._count(SET_BACK, WITNESSES)
        self._count(SET_BACK, 1)
        return []

    def _begin_anew(self, first_ns: list[int]) -> list[tuple[int, T]]:
        """Restart with the earlier items, returned as accepted, since the first items had wrong stamps."""
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
        if not self._dropped[name]:  # remove zero counts
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
