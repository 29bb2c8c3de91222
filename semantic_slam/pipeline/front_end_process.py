"""A front end in a process of its own, which reads ahead and perceives while this process infers.

``python -m semantic_slam.pipeline.front_end_process SOCKET`` takes its order on that file descriptor, and sends what it
makes of the bag.
"""

import sys
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from semantic_slam.bag.mcap_stream import RawMessage
from semantic_slam.bag.reader import BagReader
from semantic_slam.child_process import ChildProcess, told
from semantic_slam.errors import InputError, SemanticSlamError
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.pipeline.front_end import FrontEnd, Reading, ReadingOrder, Receiver

MODULE = "semantic_slam.pipeline.front_end_process"


Made = tuple[str, Any]
"""The method of a receiver that takes what was made of the bag next, and its argument."""


class FrontEndProcess:
    """Has a process read a bag; what it makes of it is passed on here, in order."""

    def __init__(self, order: ReadingOrder, receiver: Receiver) -> None:
        self._order, self._receiver = order, receiver
        self.reading: Reading | None = None  # None: not known, as the process was lost

    def read(self, check_interrupts: Callable[[], None]) -> None:
        """Pass on all that a process makes of the bag, up to what ``check_interrupts`` raises.

        Where the run cannot go on, what was read ahead is left, and counts in :attr:`reading`. Raises SemanticSlamError
        where the process has ended or fails.
        """
        child = ChildProcess("the process that reads the bag", MODULE)
        try:
            child.send(self._order)
            self._pass_on(child, check_interrupts)
        except BaseException:
            child.end(at_once=True)
            raise
        child.end(at_once=False)

    def _pass_on(self, child: ChildProcess, check_interrupts: Callable[[], None]) -> None:
        """Take everything up to the last message, which says what became of the bag."""
        stopped: BaseException | None = None
        while not isinstance(made := child.receive(), Reading):
            if isinstance(made, Exception):
                raise made
            if stopped is None and (stopped := self._taken(made, check_interrupts)) is not None:
                with suppress(SemanticSlamError):  # it may have read all, and have ended
                    child.send(None)  # it is to stop, and to say what became of the bag
        self.reading = made
        if isinstance(stopped, InputError):
            self.reading = made._replace(fault=stopped)
        elif stopped is not None:
            raise stopped

    def _taken(self, made: Made, check_interrupts: Callable[[], None]) -> BaseException | None:
        """Have the receiver take something; returns what ends the run, or None."""
        try:
            check_interrupts()
            taken_by, value = made
            getattr(self._receiver, taken_by)(value)
        except (SemanticSlamError, KeyboardInterrupt) as fault:
            return fault
        return None


class _StopError(Exception):
    """Nothing more is wanted."""


class _Sender:
    """A receiver that sends all to the other process."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def copy(self, message: RawMessage) -> None:
        self._connection.send(("copy", message))

    def measured(self, measurements: SemanticMeasurements) -> None:
        self._connection.send(("measured", measurements))

    def keyframe(self, keyframe: Keyframe) -> None:
        self._connection.send(("keyframe", keyframe))

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
                front = FrontEnd(order, reader, sender)
                with suppress(_StopError):
                    front.read(sender.check)
            connection.send(front.reading)
        except ConnectionError:
            raise
        except Exception as fault:
            connection.send(told(fault))


if __name__ == "__main__":
    serve(Connection(int(sys.argv[1])))
