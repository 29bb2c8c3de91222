"""Messages of one topic of the rounds that wait for those before them, by run and keyframe."""

from collections import Counter
from collections.abc import Container
from typing import Generic, TypeVar

T = TypeVar("T")
MOST_WAITING = 5000


class Waiting(Generic[T]):
    """What waits; each of its changes tells what it has dropped, by reason."""

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self._items: dict[str, dict[int, T]] = {}  # by run, the one that has waited longest first
        self._number = 0

    def has(self, run_id: str, index: int) -> bool:
        """Whether a keyframe's message waits."""
        return index in self._items.get(run_id, {})

    def keep(self, run_id: str, index: int, item: T) -> Counter[str]:
        """Let it wait; the oldest one goes where there are too many."""
        if not self.has(run_id, index):
            self._number += 1
        self._items.setdefault(run_id, {})[index] = item
        if self._number <= MOST_WAITING:
            return Counter()
        oldest = next(iter(self._items))
        self.pop(oldest, next(iter(self._items[oldest])))
        return Counter({f"{self.topic}: of no run that goes on": 1})

    def pop(self, run_id: str, index: int) -> T | None:
        """Take a keyframe's message out; None where none waits."""
        items = self._items.get(run_id, {})
        item = items.pop(index, None)
        if item is not None:
            self._number -= 1
            if not items:
                del self._items[run_id]
        return item

    def without_others(self, runs: Container[str]) -> Counter[str]:
        """Drop what is of none of these runs."""
        others = [run_id for run_id in self._items if run_id not in runs]
        number = sum(len(self._items.pop(run_id)) for run_id in others)
        self._number -= number
        return Counter({f"{self.topic}: of a run that is not announced": number}) if number else Counter()
