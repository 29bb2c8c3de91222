"""Orderly shutdown of a node on Ctrl-C (SIGINT), without a traceback."""

import os
import signal
import threading
from collections.abc import Callable
from typing import Any

from rclpy.task import Future

from semantic_slam.interrupts import NotedInterrupt


class Interrupt(Future):  # type: ignore[misc]  # rclpy is not followed by mypy
    """SIGINT as a future for ``spin_until_future_complete``, whose executor ``wake`` has poll it.

    Installed when it is constructed. It raises no KeyboardInterrupt: an exception out of a C++ constructor or
    destructor turns into another one or is only printed, and a second Ctrl-C (a terminal and a launcher each send one)
    would interrupt the closing of a bag.
    """

    def __init__(self, wake: Callable[[], None]) -> None:
        super().__init__()
        self._noted = NotedInterrupt()
        signal.signal(signal.SIGINT, self._noted)
        signalled, at_signal = os.pipe()
        os.set_blocking(at_signal, False)
        signal.set_wakeup_fd(at_signal, warn_on_full_buffer=False)
        threading.Thread(target=_wake_at_signal, args=(signalled, wake), daemon=True).start()

    def done(self) -> bool:
        """Whether SIGINT was received."""
        return self._noted.has_come

    def add_done_callback(self, callback: Any) -> None:
        """Discard the callback: an executor adds one per callback that it runs, which would accumulate.

        No callback would ever be called, because the future never gets a result.
        """


def _wake_at_signal(signalled: int, wake: Callable[[], None]) -> None:
    """Call ``wake`` at the first signal: the main thread, which alone runs handlers, waits in the executor's C++."""
    os.read(signalled, 1)
    wake()
