"""A process of our own beside this one, which shares its work; both speak in pickles over a socket of their own."""

import os
import socket
import subprocess
import sys
import traceback
from multiprocessing.connection import Connection
from typing import Any

from semantic_slam.errors import SemanticSlamError
from semantic_slam.interrupts import raised_at_once

GRACE_S = 5.0
"""How long a process may take to end once nothing more will be asked of it."""


def with_traceback(fault: Exception) -> Exception:
    """An error as sent to the other process, which raises it there; unexpected ones carry their traceback as a note."""
    if not isinstance(fault, SemanticSlamError):
        fault.add_note(traceback.format_exc())
    return fault


class ChildProcess:
    """Runs ``python -m MODULE ... SOCKET``, SOCKET being the number of the file descriptor that it inherits.

    The process has to end when the socket is closed, as it is when this process ends in any way. Ctrl-C on the terminal
    does not reach it.
    """

    def __init__(self, name: str, module: str, *words: str) -> None:
        """Start it. ``name`` is what errors call it."""
        self._name = name
        ours, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", module, *words, str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
                env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},  # the very code of this process
                start_new_session=True,
            )
        self._connection = Connection(ours.detach())

    @property
    def process_id(self) -> int:
        """The operating system's number of the process."""
        return self._process.pid

    def send(self, value: Any) -> None:
        """Send a value. Raises SemanticSlamError if the process has ended."""
        try:
            self._connection.send(value)
        except OSError:
            raise self._ended() from None

    def receive(self, timeout_s: float | None = None) -> Any:
        """The next value that the process has sent. Raises SemanticSlamError if it has ended.

        Raises TimeoutError where none comes within ``timeout_s``; None: however long it takes. Ctrl-C raises
        KeyboardInterrupt at once while nothing has come, also where it is noted elsewhere.
        """
        try:
            with raised_at_once():
                came = self._connection.poll(timeout_s)
            value = self._connection.recv() if came else None
        except (EOFError, OSError):  # the second in the midst of a value
            raise self._ended() from None
        if not came:
            raise TimeoutError(f"{self._name} has not answered for {timeout_s} s")
        return value

    def end(self, *, at_once: bool) -> None:
        """End the process: ``at_once``, or as soon as it notices that the socket is closed."""
        if at_once:
            self._process.kill()
        self._connection.close()
        try:
            self._process.wait(GRACE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _ended(self) -> SemanticSlamError:
        return SemanticSlamError(
            f"{self._name} ended with exit code {self._process.wait()}; free memory, or run all in one process:"
            " --processes 1"
        )
