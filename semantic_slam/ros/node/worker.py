"""The thread that does a node's work, so that its callbacks only have to queue."""

import queue
import threading
from collections.abc import Callable
from typing import Any

STOP = object()
PATIENCE_S = 1.0
"""For which whoever stops a worker waits for what it is at."""


class Worker:
    """Calls queued functions one after the other; ends at the first exception, which it hands to ``on_fault``."""

    def __init__(self, on_fault: Callable[[Exception], None]) -> None:
        self._on_fault = on_fault
        self._items: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._may_work = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        """Begin, or go on."""
        self._may_work.set()
        if not self._thread.ident:
            self._thread.start()

    def suspend(self) -> None:
        """Begin nothing new until it is started again; what is submitted meanwhile waits."""
        self._may_work.clear()

    def submit(self, function: Callable[[Any], None], item: Any) -> None:
        """Have ``function(item)`` called after all that was submitted before."""
        self._items.put((function, item))

    @property
    def has_more(self) -> bool:
        """Whether something else waits to be done."""
        return not self._items.empty()

    def stop(self) -> None:
        """Let what was submitted before be done, for at most ``PATIENCE_S``."""
        self._may_work.set()
        self._items.put(STOP)
        if self._thread.is_alive():
            self._thread.join(PATIENCE_S)

    def _run(self) -> None:
        try:
            while (item := self._items.get()) is not STOP:
                self._may_work.wait()
                function, argument = item
                function(argument)
        except Exception as fault:
            self._on_fault(fault)
