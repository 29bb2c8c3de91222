"""The one place where errors become exit codes: 0 done, 2 bad input or usage, 1 a fault of ours, 130 interrupted."""

import argparse
import errno
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

from semantic_slam.errors import InputError

FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
"""What a disk says that takes no more."""
DONE, FAULT, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130


def program() -> str:
    """What the user has called: ``semantic_slam report``, or its alias ``bag_to_report``."""
    return Path(sys.argv[0]).name.removesuffix(".py")


class CommandParser(argparse.ArgumentParser):
    """An argument parser whose complaints are bad input like any other: one line, exit code 2."""

    def __init__(self, prog: str | None = None, **options: Any) -> None:
        super().__init__(prog or program(), **options)

    def error(self, message: str) -> NoReturn:
        """Called by argparse; raises InputError."""
        raise InputError(f"{self.prog}: {message}; {self.prog} --help tells what is possible")


def exit_code(command: Callable[[], None]) -> int:
    """Run ``command``; bad input gives one line on stderr, a fault of ours its traceback."""
    try:
        command()
    except InputError as error:
        print(" ".join(str(error).split()), file=sys.stderr)
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
    """Whether Ctrl-C is behind a fault: in the midst of an import it becomes another exception."""
    while fault is not None:
        if isinstance(fault, KeyboardInterrupt):
            return True
        fault = fault.__cause__ or fault.__context__
    return False


def run_main(command: Callable[[], None]) -> None:
    """What every ``main()`` does: run ``command`` (parsing included) and leave the process with its exit code."""
    sys.exit(exit_code(command))
