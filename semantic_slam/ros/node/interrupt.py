"""How a node ends when it is asked to by Ctrl-C: in order, once, and with nothing on the console."""

import os
import signal
import sys
from contextlib import suppress
from typing import Any, NoReturn

from rclpy.task import Future


class Interrupt(Future):  # type: ignore[misc]  # rclpy is not followed by mypy
    """Ctrl-C, from now on, as a future that an executor spins until: rclpy's own handler wakes it, and it asks.

    Nothing is raised: an exception out of a destructor or a constructor in C++ becomes another, or is only printed,
    and a second Ctrl-C (a terminal and a launcher each send one) would break off what closes a bag.
    """

    def __init__(self) -> None:
        super().__init__()
        self._has_come = False
        signal.signal(signal.SIGINT, self._note)

    def done(self) -> bool:
        """Whether it has come."""
        return self._has_come

    def add_done_callback(self, callback: Any) -> None:
        """Keep nothing: an executor adds one before every callback that it runs, for as long as a node lives.

        None is ever called, for nobody sets a result.
        """

    def _note(self, *_: Any) -> None:
        self._has_come = True  # and nothing that takes a lock, which whatever is interrupted may hold


def leave(code: int) -> NoReturn:
    """End the process with this exit code; threads of the middleware that still run do not see Python end."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    os._exit(code)
