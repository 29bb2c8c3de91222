"""Messages of one topic in the order of their stamps, for matching with another topic's."""

from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator
from typing import Generic, TypeVar

T = TypeVar("T")


class StampedBuffer(Generic[T]):
    """Items of one topic. A stamp that does not grow is refused and counted: a topic's clock only runs forward."""

    def __init__(self, topic: str, dropped: Counter[str], capacity: int | None = None) -> None:
        """``dropped`` counts what is refused, and what is pushed out once ``capacity`` items wait."""
        self.topic = topic
        self.last_stamp_ns: int | None = None
        self._dropped = dropped
        self._capacity = capacity
        self._stamps: list[int] = []
        self._items: list[T] = []

    def __len__(self) -> int:
        return len(self._stamps)

    def __iter__(self) -> Iterator[tuple[int, T]]:
        return iter(zip(self._stamps, self._items, strict=True))

    def add(self, stamp_ns: int, item: T) -> None:
        """Append an item that is newer than all before it."""
        if self.last_stamp_ns is not None and stamp_ns <= self.last_stamp_ns:
            backwards = stamp_ns < self.last_stamp_ns
            self._dropped[f"{self.topic}: time goes backwards" if backwards else f"{self.topic}: stamp repeats"] += 1
            return
        self.last_stamp_ns = stamp_ns
        self._stamps.append(stamp_ns)
        self._items.append(item)
        if self._capacity is not None and len(self._stamps) > self._capacity:
            self._dropped[f"{self.topic}: nothing matched it for too long"] += 1
            del self._stamps[0], self._items[0]

    def has_reached(self, stamp_ns: int) -> bool:
        """Whether the topic's clock has come to this stamp: nothing at or before it will follow."""
        return self.last_stamp_ns is not None and self.last_stamp_ns >= stamp_ns

    def nearest(self, stamp_ns: int, tolerance_ns: int) -> T | None:
        """The item with the nearest stamp, the earlier one of two; None when none is within the tolerance."""
        position = bisect_left(self._stamps, stamp_ns)
        around = [index for index in (position - 1, position) if 0 <= index < len(self._stamps)]
        best = min(around, key=lambda index: abs(self._stamps[index] - stamp_ns), default=None)
        if best is None or abs(self._stamps[best] - stamp_ns) > tolerance_ns:
            return None
        return self._items[best]

    def forget_before(self, stamp_ns: int) -> None:
        """Remove what lies before a stamp; it has been used, or nothing asked for it."""
        position = bisect_left(self._stamps, stamp_ns)
        del self._stamps[:position], self._items[:position]

    def first(self) -> tuple[int, T]:
        """The oldest item with its stamp."""
        return self._stamps[0], self._items[0]

    def pop(self) -> T:
        """Take the oldest item out."""
        del self._stamps[0]
        return self._items.pop(0)
