"""Maps errors to exit codes: 0 success, 2 bad input or usage, 1 internal error, 130 interrupted."""

import argparse
import atexit
import errno
import os
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

from semantic_slam.errors import InputError, one_line

FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
"""Error numbers of a full disk, an exceeded quota or a file-size limit."""
DONE, FAULT, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130


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
        command()
    except InputError as error:
        print(one_line(error), file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        return INTERRUPTED
    except OSError as fault:
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
