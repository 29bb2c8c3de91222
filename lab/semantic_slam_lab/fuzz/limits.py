"""What a case may cost: seconds of CPU and bytes beyond what the process held before it."""

import resource
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from types import FrameType

import numpy as np

from semantic_slam.errors import SemanticSlamError

MEBIBYTE = 1 << 20
CPU_S = 8.0
"""Most CPU of a case where inverting ``INVERSES`` small matrices takes ``INVERSES_S``; slower machines have more.

A dozen alike things under the hundred hypotheses of a shipped configuration take up to 5 s there, and a core that
another process shares is slower than it was when that was measured.
"""
INVERSES, INVERSES_S = 10_000, 0.06
MEMORY_BYTES = 500 * MEBIBYTE
ADDRESS_SPACE_BYTES = 4096 * MEBIBYTE
"""Beyond what the process has mapped before: allocations that no machine should be asked for fail at once."""


class TooSlowError(BaseException):
    """A case took more CPU than it may; no reader's ``except Exception`` swallows that."""


class TooLargeError(BaseException):
    """A case took more memory than it may."""


def bound_address_space() -> None:
    """Let larger allocations of this process fail."""
    most = _status_bytes("VmSize") + ADDRESS_SPACE_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most, resource.getrlimit(resource.RLIMIT_AS)[1]))


@contextmanager
def limited() -> Iterator[None]:
    """A context that raises TooSlowError or TooLargeError for what its body takes, be it refused or not."""
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # the peak begins anew
    before = _status_bytes("VmRSS")
    signal.signal(signal.SIGPROF, _too_slow)
    signal.setitimer(signal.ITIMER_PROF, CPU_S * slowness())
    try:
        yield
    except SemanticSlamError:  # what is refused has cost as much; any other exception is a finding by itself
        _check_memory(before)
        raise
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    _check_memory(before)


def _check_memory(before: int) -> None:
    """Raises TooLargeError where the peak since ``limited`` began is too far above ``before``, in bytes."""
    grown = _status_bytes("VmHWM") - before
    if grown > MEMORY_BYTES:
        raise TooLargeError(f"{grown // MEBIBYTE} MiB more")


@cache
def slowness() -> float:
    """Factor by which this machine is slower than the one that ``CPU_S`` is meant for; at least 1."""
    return max(min(_inverses_s() for _ in range(3)) / INVERSES_S, 1.0)


def _inverses_s() -> float:
    """Seconds of CPU of the inverses, one by one."""
    began, matrix = time.process_time(), np.eye(6)
    for _ in range(INVERSES):
        np.linalg.inv(matrix)
    return time.process_time() - began


def _too_slow(number: int, frame: FrameType | None) -> None:
    raise TooSlowError(f"more than {CPU_S * slowness():.0f} s of CPU")


def _status_bytes(name: str) -> int:
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) << 10 for line in lines if line.startswith(f"{name}:"))
