"""A front end in a process of its own, which reads ahead and perceives while this process infers.

``python -m semantic_slam.pipeline.front_end_process SOCKET`` takes its order on that file descriptor, and sends what it
makes of the bag.
"""

import sys
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any, Self

from semantic_slam.bag.mcap_stream import RawMessage
from semantic_slam.bag.reader import BagReader
from semantic_slam.child_process import ChildProcess, with_traceback
from semantic_slam.errors import InputError, SemanticSlamError
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.pipeline.front_end import FrontEnd, Reading, ReadingOrder, Receiver

MODULE = "semantic_slam.pipeline.front_end_process"
PATIENCE_S = 0.5
"""How long to wait, after an interrupt, for each further message; a picture may take longer."""


class FrontEndProcess:
    """Has a process read a bag, which ends with this context manager; what it makes of it is passed on here, in order.

    The context begins when the process has loaded its network. Raises what loading it raises.
    """

    def __init__(self, order: ReadingOrder) -> None:
        self._order = order
        self._child = ChildProcess("the process that reads the bag", MODULE)
        self.reading: Reading | None = None  # None: not known, as the process was lost or could not be waited for

    def __enter__(self) -> Self:
        try:
            self._child.send(self._order)
            self._received()
        except BaseException:
            self._child.end(at_once=True)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._child.end(at_once=kind is not None)

    def read(self, receiver: Receiver, check_interrupts: Callable[[], None]) -> None:
        """Pass on all that the process makes of the bag to ``receiver``, up to what ``check_interrupts`` raises.

        Where the run cannot go on, what was read ahead is left, and counts in :attr:`reading`. Raises SemanticSlamError
        where the process has ended or fails.
        """
        stopped = self._pass_on(receiver, check_interrupts)
        if stopped is not None:
            self._stop(stopped)

    def _pass_on(self, receiver: Receiver, check_interrupts: Callable[[], None]) -> BaseException | None:
        """Have the receiver take everything up to the last message, the reading; returns what ends the run before."""
        while True:
            try:
                made = self._received()
            except KeyboardInterrupt as interrupt:
                return interrupt
            if isinstance(made, Reading):
                self.reading = made
                return None
            try:
                check_interrupts()
                taken_by, value = made
                getattr(receiver, taken_by)(value)
            except (SemanticSlamError, KeyboardInterrupt) as fault:
                return fault

    def _stop(self, stopped: BaseException) -> None:
        """Have the process stop and say what became of the bag; raises ``stopped``, unless the reading tells it."""
        with suppress(SemanticSlamError):  # it may have read all, and have ended
            self._child.send(None)
        patience_s = PATIENCE_S if isinstance(stopped, KeyboardInterrupt) else None
        try:
            while not isinstance(made := self._received(patience_s), Reading):
                pass
        except TimeoutError:
            raise stopped from None
        self.reading = made
        if not isinstance(stopped, InputError):
            raise stopped
        self.reading = made._replace(fault=stopped)

    def _received(self, timeout_s: float | None = None) -> Any:
        """What the process has sent next; raises what it has raised, and TimeoutError where nothing comes in time."""
        made = self._child.receive(timeout_s)
        if isinstance(made, Exception):
            raise made
        return made


class _StopError(Exception):
    """Nothing more is wanted."""


class _Sender:
    """A receiver that sends all to the other process."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def copy(self, message: RawMessage) -> None:
        self._connection.send(("copy", message))

    def measured(self, message: RawMessage) -> None:
        self._connection.send(("measured", message))

    def keyframe(self, keyframe: Keyframe) -> None:
        self._connection.send(("keyframe", keyframe))

    def say(self, line: str) -> None:
        self._connection.send(("say", line))

    def check(self) -> None:
        """Raises _StopError where the other process has said so, or ended."""
        if self._connection.poll():
            raise _StopError


def serve(connection: Connection) -> None:
    """Read a bag as ordered over ``connection``; ends early where the other process says so, or ends."""
    order: ReadingOrder = connection.recv()
    sender = _Sender(connection)
    with suppress(ConnectionError):
        try:
            with BagReader(order.bag, announces=False) as reader:
                front = FrontEnd(order, reader)
                connection.send(None)  # all is loaded
                with suppress(_StopError):
                    front.read(sender, sender.check)
            connection.send(front.reading)
        except ConnectionError:
            raise
        except Exception as fault:
            connection.send(with_traceback(fault))


if __name__ == "__main__":
    serve(Connection(int(sys.argv[1])))
