"""Buffer for messages of one topic that arrive ahead of their predecessors, by run and keyframe."""

from collections import Counter
from collections.abc import Container
from typing import Generic, TypeVar

T = TypeVar("T")
MOST_WAITING = 5000


class Waiting(Generic[T]):
    """Buffer of at most ``MOST_WAITING`` messages; methods that drop some return the counts by reason."""

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self._items: dict[str, dict[int, T]] = {}  # by run, in order of insertion
        self._number = 0

    def has(self, run_id: str, index: int) -> bool:
        """Whether the message of this keyframe is buffered."""
        return index in self._items.get(run_id, {})

    def keep(self, run_id: str, index: int, item: T) -> Counter[str]:
        """Buffer a message; drops the oldest one if there are too many."""
        if not self.has(run_id, index):
            self._number += 1
        self._items.setdefault(run_id, {})[index] = item
        if self._number <= MOST_WAITING:
            return Counter()
        oldest = next(iter(self._items))
        self.pop(oldest, next(iter(self._items[oldest])))
        return Counter({f"{self.topic}: of no run that goes on": 1})

    def pop(self, run_id: str, index: int) -> T | None:
        """Remove and return the message of this keyframe; None if there is none."""
        items = self._items.get(run_id, {})
        item = items.pop(index, None)
        if item is not None:
            self._number -= 1
            if not items:
                del self._items[run_id]
        return item

    def without_others(self, runs: Container[str]) -> Counter[str]:
        """Drop the messages of all other runs."""
        others = [run_id for run_id in self._items if run_id not in runs]
        number = sum(len(self._items.pop(run_id)) for run_id in others)
        self._number -= number
        return Counter({f"{self.topic}: of a run that is not announced": number}) if number else Counter()
