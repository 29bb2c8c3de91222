"""Worker thread that processes a node's messages, so that executor callbacks only queue them."""

import queue
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

STOP = object()
PATIENCE_S = 1.0
"""How long :meth:`Worker.stop` waits for the queued calls."""
LAST_CALL_S = 0.5
"""How long it then waits for the call in progress."""


class Worker:
    """Calls queued functions in order; ends at the first exception, which it passes to ``on_fault``."""

    def __init__(self, on_fault: Callable[[Exception], None]) -> None:
        self._on_fault = on_fault
        self._items: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._may_work = threading.Event()
        self._is_told_to_end = threading.Event()
        self._leaves_rest = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        """Start the thread, or resume after :meth:`suspend`."""
        self._may_work.set()
        if not self._thread.ident:
            self._thread.start()

    def suspend(self) -> None:
        """Start no further function until :meth:`start`; submissions are queued meanwhile."""
        self._may_work.clear()

    def submit(self, function: Callable[[Any], None], item: Any) -> None:
        """Queue the call ``function(item)``."""
        self._items.put((function, item))

    @property
    def has_more(self) -> bool:
        """Whether further calls are queued."""
        return not self._items.empty()

    @property
    def is_ending(self) -> bool:
        """Whether :meth:`stop` was called: a call that waits for other nodes should return."""
        return self._is_told_to_end.is_set()

    @property
    def is_working(self) -> bool:
        """Whether a call is in progress, or may begin: after :meth:`stop` only one that takes very long."""
        return self._thread.is_alive()

    def stop(self) -> None:
        """End the thread after the calls queued so far; those not begun within ``PATIENCE_S`` are left in the queue."""
        self._is_told_to_end.set()
        self._may_work.set()
        self._items.put(STOP)
        if self._thread.is_alive():
            self._thread.join(PATIENCE_S)
            self._leaves_rest.set()
            self._thread.join(LAST_CALL_S)

    def left(self) -> list[Any]:
        """Take the queued calls that were never begun, and return their arguments; call it after :meth:`stop`."""
        arguments = []
        with suppress(queue.Empty):
            while True:
                item = self._items.get_nowait()
                arguments += [item[1]] if item is not STOP else []
        return arguments

    def _run(self) -> None:
        try:
            while not self._leaves_rest.is_set() and (item := self._items.get()) is not STOP:
                self._may_work.wait()
                function, argument = item
                function(argument)
        except Exception as fault:
            self._on_fault(fault)
