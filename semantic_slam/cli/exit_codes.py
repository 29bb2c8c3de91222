"""Maps errors to exit codes: 0 success, 2 bad input or usage, 1 internal error, 130 interrupted, 141 nobody reads."""

import argparse
import atexit
import errno
import os
import select
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

from semantic_slam.errors import InputError, one_line

FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
"""Error numbers of a full disk, an exceeded quota or a file-size limit."""
DONE, FAULT, BAD_INPUT, INTERRUPTED, UNREAD = 0, 1, 2, 130, 141
"""Exit codes; the last two are those of programs that a shell sees end by SIGINT, and by SIGPIPE."""


def program() -> str:
    """Name of the program as called: ``semantic_slam report``, or its alias ``bag_to_report``."""
    return Path(sys.argv[0]).name.removesuffix(".py")


class CommandParser(argparse.ArgumentParser):
    """Argument parser that reports usage errors as InputError: one line, exit code 2."""

    def __init__(self, prog: str | None = None, **options: Any) -> None:
        super().__init__(prog or program(), **options)

    def error(self, message: str) -> NoReturn:
        """Called by argparse; raises InputError."""
        raise InputError(f"{self.prog}: {message}; {self.prog} --help tells what is possible")


def exit_code(command: Callable[[], None]) -> int:
    """Run ``command`` and return its exit code; bad input prints one line to stderr, internal errors a traceback."""
    try:
        _run(command)
    except InputError as error:
        print(one_line(error), file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        return INTERRUPTED
    except OSError as fault:
        if isinstance(fault, BrokenPipeError) and _silence_unread():
            return UNREAD
        if fault.errno not in FULL:
            traceback.print_exc()
        else:
            print(f"{fault.filename or program()}: {fault.strerror}; make room, and run it again", file=sys.stderr)
        return FAULT
    except Exception as fault:
        if _is_of_an_interrupt(fault):
            return INTERRUPTED
        traceback.print_exc()
        return FAULT
    return DONE


def _run(command: Callable[[], None]) -> None:
    """Run ``command`` and write out what it printed, so that a reader who has left is noticed here."""
    try:
        command()
    except SystemExit:  # as after --help
        _write_out()
        raise
    _write_out()


def _write_out() -> None:
    if sys.stdout is not None:
        sys.stdout.flush()


def _silence_unread() -> bool:
    """Whether the reader of what is printed has left, as ``head`` does; what is left is then written to nowhere.

    Pipes within the program break, too: those are faults.
    """
    unread = [number for number in (1, 2) if _has_no_reader(number)]
    for number in unread:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, number)
        os.close(nowhere)
    return bool(unread)


def _has_no_reader(number: int) -> bool:
    """Whether a file descriptor is a pipe or socket whose other end is closed."""
    poll = select.poll()
    poll.register(number, 0)
    return any(event & (select.POLLERR | select.POLLHUP) for _, event in poll.poll(0))


def _is_of_an_interrupt(fault: BaseException | None) -> bool:
    """Whether an exception was caused by Ctrl-C, which during an import turns into another exception."""
    while fault is not None:
        if isinstance(fault, KeyboardInterrupt):
            return True
        fault = fault.__cause__ or fault.__context__
    return False


def run_main(command: Callable[[], None]) -> None:
    """Body of every ``main()``: run ``command``, including parsing, and exit with its exit code."""
    codes: list[int] = []
    atexit.register(_leave_if_interrupted, codes)  # before all others, and therefore called after them
    codes.append(exit_code(command))
    sys.exit(codes[0])


def _leave_if_interrupted(codes: list[int]) -> None:
    """End an interrupted command without finalising Python.

    A thread may still import a library, and from an interrupt inside of ``exec``, as of a dataclass, Python ends by the
    signal although it was handled.
    """
    if codes == [INTERRUPTED]:
        leave(INTERRUPTED)


def leave(code: int) -> NoReturn:
    """End the process at once with this exit code, without finalising Python under running threads."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    os._exit(code)
