"""Orderly shutdown of a node on Ctrl-C (SIGINT), without a traceback."""

import os
import signal
import sys
from contextlib import suppress
from typing import Any, NoReturn

from rclpy.task import Future


class Interrupt(Future):  # type: ignore[misc]  # rclpy is not followed by mypy
    """SIGINT as a future for ``spin_until_future_complete``: rclpy's handler wakes the executor, which then polls it.

    Installed when it is constructed. It raises no KeyboardInterrupt: an exception out of a C++ constructor or
    destructor turns into another one or is only printed, and a second Ctrl-C (a terminal and a launcher each send one)
    would interrupt the closing of a bag.
    """

    def __init__(self) -> None:
        super().__init__()
        self._has_come = False
        signal.signal(signal.SIGINT, self._note)

    def done(self) -> bool:
        """Whether SIGINT was received."""
        return self._has_come

    def add_done_callback(self, callback: Any) -> None:
        """Discard the callback: an executor adds one per callback that it runs, which would accumulate.

        No callback would ever be called, because the future never gets a result.
        """

    def _note(self, *_: Any) -> None:
        self._has_come = True  # take no lock here: the interrupted code may hold it


def leave(code: int) -> NoReturn:
    """End the process at once with this exit code, without finalising Python under running middleware threads."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    os._exit(code)
