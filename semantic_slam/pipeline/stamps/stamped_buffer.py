"""Buffer of one topic's messages in stamp order, for matching with those of another topic."""

from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any, ClassVar, Generic, TypeVar

from semantic_slam.pipeline.stamps.topic_clock import MOST_EARLIER, TopicClock

T = TypeVar("T")


class StampedBuffer(Generic[T]):
    """Items of one topic whose stamps the topic's clock accepts; the others are refused and counted."""

    STATE: ClassVar[tuple[str, ...]] = ("last_stamp_ns", "_clock", "_stamps", "_items")

    def __init__(
        self,
        topic: str,
        dropped: Counter[str],
        capacity: int | None = None,
        made_of: Callable[[Any], T] | None = None,
    ) -> None:
        """``dropped`` counts refused items, and the oldest ones removed when more than ``capacity`` are buffered.

        ``made_of`` converts an added item to the stored one; it is called in stamp order, for accepted items only.
        """
        self.last_stamp_ns: int | None = None
        self._clock: TopicClock[Any] = TopicClock(topic, dropped, capacity or MOST_EARLIER)
        self._dropped = dropped
        self._capacity = capacity
        self._made_of = made_of
        self._stamps: list[int] = []
        self._items: list[T] = []

    @property
    def topic(self) -> str:
        """Name under which refused and removed items are counted."""
        return self._clock.topic

    @topic.setter
    def topic(self, name: str) -> None:
        self._clock.topic = name

    def __len__(self) -> int:
        return len(self._stamps)

    def __iter__(self) -> Iterator[tuple[int, T]]:
        return iter(zip(self._stamps, self._items, strict=True))

    @property
    def is_settled(self) -> bool:
        """Whether no item that was appended can be withdrawn any more."""
        return self._clock.is_settled

    def settle(self) -> None:
        """Withdraw no item from now on, as the first ones are in use."""
        self._clock.settle()

    @property
    def is_holding(self) -> bool:
        """Whether an item with a suspicious stamp is on hold until the next ones confirm or refute it."""
        return self._clock.is_holding

    @property
    def is_set_back(self) -> bool:
        """Whether the topic's clock was set back."""
        return self._clock.is_set_back

    @property
    def begins_again(self) -> bool:
        """Whether the topic's clock was set back to about its start or earlier, so that another session has begun."""
        return self._clock.begins_again

    def go_on_from(self, former: "StampedBuffer[T]") -> None:
        """Add the items of this session that the buffer of the previous one has refused."""
        self.topic = former.topic
        for stamp_ns, item in former._clock.earlier:
            self.add(stamp_ns, item)

    def add(self, stamp_ns: int, item: Any) -> None:
        """Add an item; it is appended once its stamp is accepted."""
        taken = self._clock.take(stamp_ns, item)
        if self._clock.withdrawn_from_ns is not None:
            position = bisect_left(self._stamps, self._clock.withdrawn_from_ns)
            del self._stamps[position:], self._items[position:]
        for believed in taken:
            self._append(*believed)

    def release(self) -> None:
        """Append the items on hold, as no more will come."""
        for believed in self._clock.release():
            self._append(*believed)

    def _append(self, stamp_ns: int, item: Any) -> None:
        self.last_stamp_ns = stamp_ns
        self._stamps.append(stamp_ns)
        self._items.append(self._made_of(item) if self._made_of else item)
        if self._capacity is not None and len(self._stamps) > self._capacity:
            self._dropped[f"{self.topic}: nothing matched it for too long"] += 1
            del self._stamps[0], self._items[0]

    @property
    def newest(self) -> T | None:
        """The newest buffered item; None if there is none."""
        return self._items[-1] if self._items else None

    def has_reached(self, stamp_ns: int) -> bool:
        """Whether the topic's clock has reached this stamp, so that no item at or before it will follow."""
        return self.last_stamp_ns is not None and self.last_stamp_ns >= stamp_ns

    def nearest(self, stamp_ns: int, tolerance_ns: int) -> T | None:
        """The item with the nearest stamp, on a tie the earlier one; None if none is within the tolerance."""
        position = bisect_left(self._stamps, stamp_ns)
        around = [index for index in (position - 1, position) if 0 <= index < len(self._stamps)]
        best = min(around, key=lambda index: abs(self._stamps[index] - stamp_ns), default=None)
        if best is None or abs(self._stamps[best] - stamp_ns) > tolerance_ns:
            return None
        return self._items[best]

    def forget_before(self, stamp_ns: int) -> None:
        """Remove the items before a stamp, which are not needed any more."""
        position = bisect_left(self._stamps, stamp_ns)
        del self._stamps[:position], self._items[:position]

    def first(self) -> tuple[int, T]:
        """The oldest item with its stamp."""
        return self._stamps[0], self._items[0]

    def pop(self) -> T:
        """Remove and return the oldest item."""
        del self._stamps[0]
        return self._items.pop(0)
