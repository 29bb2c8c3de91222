"""Lossless lock-step: how many detection frames may be under way."""

import threading
import time
from collections.abc import Callable

CHECK_S = 0.2


class Credit:
    """Flow control by credit: at most ``window`` frames are sent and not yet done with.

    It bounds memory; what keeps every message is the quality of service. So, when nothing has moved for
    ``stall_s`` (the pipeline may wait for a message that only comes later), one more frame may go.
    """

    def __init__(self, window: int, stall_s: float) -> None:
        self._window = window
        self._stall_s = stall_s
        self._done = 0
        self._changed = threading.Condition()

    def done(self, frames: int) -> None:
        """``frames`` are done with, counted from the start; repeated or older counts change nothing."""
        with self._changed:
            if frames > self._done:
                self._done = frames
                self._changed.notify_all()

    @property
    def frames_done(self) -> int:
        return self._done

    def wait(self, sent: int, running: Callable[[], bool]) -> bool:
        """Wait until a frame may follow the ``sent`` ones; False when it follows only because nothing moved."""
        with self._changed:
            since, before = time.monotonic(), self._done
            while sent - self._done >= self._window and running():
                self._changed.wait(CHECK_S)
                if self._done != before:
                    since, before = time.monotonic(), self._done
                elif time.monotonic() - since > self._stall_s:
                    return False
        return True
