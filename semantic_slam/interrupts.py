"""Ctrl-C (SIGINT) where raising KeyboardInterrupt would do harm: noted, or waited for on the main thread alone."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from types import FrameType


class NotedInterrupt:
    """SIGINT handler that notes in ``has_come`` that a signal came, and raises nothing.

    It takes no lock, as the interrupted code may hold it.
    """

    def __init__(self) -> None:
        self.has_come, self._was_raised = False, False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self.has_come = True

    def check(self) -> None:
        """Raise KeyboardInterrupt if a signal was noted; once."""
        if self.has_come and not self._was_raised:
            self._was_raised = True
            raise KeyboardInterrupt


class _FirstNoted(NotedInterrupt):
    """Raises KeyboardInterrupt at the second signal."""

    def __call__(self, number: int, frame: FrameType | None) -> None:
        if self.has_come:
            signal.default_int_handler(number, frame)
        super().__call__(number, frame)


@contextmanager
def noted_interrupts() -> Iterator[Callable[[], None]]:
    """Context with a function that raises KeyboardInterrupt if SIGINT has come; a second SIGINT raises it at once.

    For what an exception out of a callback may abort, such as a solver. Outside the main thread, or if Python's default
    SIGINT handler is not installed, nothing is changed.
    """
    ours = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if not ours or not _is_main_thread():
        yield lambda: None
        return
    noted = _FirstNoted()
    signal.signal(signal.SIGINT, noted)
    try:
        yield noted.check
        noted.check()
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def import_interruptibly(name: str) -> None:
    """Import a module that takes seconds, on a thread of its own: Ctrl-C raises KeyboardInterrupt at once meanwhile.

    So does one that a :class:`NotedInterrupt` has noted before. Within the import nothing is raised, which makes
    PyTorch abort the process; the thread goes on with it until the process ends. Outside the main thread the module is
    simply imported. Raises what the import raises.
    """
    if not _is_main_thread():
        import_module(name)
        return
    faults: list[BaseException] = []

    def load() -> None:
        try:
            import_module(name)
        except BaseException as fault:
            faults.append(fault)

    thread = threading.Thread(target=load, daemon=True)
    with raised_at_once():
        thread.start()
        thread.join()
    if faults:
        raise faults[0]


@contextmanager
def raised_at_once() -> Iterator[None]:
    """Context for a wait, in which SIGINT raises KeyboardInterrupt where a NotedInterrupt would note it, or has.

    Outside the main thread nothing is changed.
    """
    handler = signal.getsignal(signal.SIGINT)
    if not isinstance(handler, NotedInterrupt) or not _is_main_thread():
        yield
        return
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        handler.check()
        yield
    finally:
        signal.signal(signal.SIGINT, handler)


def _is_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()
