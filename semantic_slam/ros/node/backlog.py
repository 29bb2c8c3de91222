"""Bounded queue for the messages of one topic that arrive faster than they are processed."""

import threading
from collections import deque


class Backlog:
    """Queue of the newest ``most`` messages, which bounds the latency of processing; thread-safe."""

    def __init__(self, most: int) -> None:
        self._waiting: deque[bytes] = deque(maxlen=most)
        self._most = most
        self._lock = threading.Lock()

    def add(self, data: bytes) -> bool:
        """Append a message; returns whether the queue was full, so that the oldest message was discarded."""
        with self._lock:
            is_full = len(self._waiting) == self._most
            self._waiting.append(data)
        return is_full

    def __len__(self) -> int:
        """Number of messages that wait."""
        return len(self._waiting)

    def take(self) -> bytes:
        """Remove and return the oldest message."""
        with self._lock:
            return self._waiting.popleft()
