"""Flow control of the lossless lock-step replay: limits the detection frames in flight."""

import threading
import time
from collections.abc import Callable

CHECK_S = 0.2


class Credit:
    """Credit-based flow control: at most ``window`` frames are sent but not yet processed.

    It bounds memory; losslessness is ensured by QoS. Therefore one more frame may be sent after ``stall_s`` seconds
    without progress, since the pipeline may be waiting for a later message.
    """

    def __init__(self, window: int, stall_s: float) -> None:
        self._window = window
        self._stall_s = stall_s
        self._done = 0
        self._changed = threading.Condition()

    def done(self, frames: int) -> None:
        """Set the number of frames processed since the start; repeated or lower numbers are ignored."""
        with self._changed:
            if frames > self._done:
                self._done = frames
                self._changed.notify_all()

    @property
    def frames_done(self) -> int:
        return self._done

    def wait(self, sent: int, running: Callable[[], bool]) -> bool:
        """Wait until another frame may be sent after ``sent`` ones; returns False if only because of a stall."""
        with self._changed:
            since, before = time.monotonic(), self._done
            while sent - self._done >= self._window and running():
                self._changed.wait(CHECK_S)
                if self._done != before:
                    since, before = time.monotonic(), self._done
                elif time.monotonic() - since > self._stall_s:
                    return False
        return True
