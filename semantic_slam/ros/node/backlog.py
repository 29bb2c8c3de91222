"""Messages of one topic that came faster than they are worked on."""

import threading
from collections import deque


class Backlog:
    """At most ``most`` messages wait, the newest ones: what is worked on is late by no more than these take."""

    def __init__(self, most: int) -> None:
        self._waiting: deque[bytes] = deque(maxlen=most)
        self._most = most
        self._lock = threading.Lock()

    def add(self, data: bytes) -> bool:
        """Let a message wait; whether the oldest one has gone for it, so that no more wait than before."""
        with self._lock:
            is_full = len(self._waiting) == self._most
            self._waiting.append(data)
        return is_full

    def take(self) -> bytes:
        """The oldest one that waits."""
        with self._lock:
            return self._waiting.popleft()
