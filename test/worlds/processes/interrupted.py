"""Programs that are interrupted at some point, and what CPU they take from then on."""

import os
import resource
import signal
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from semantic_slam_lab.fuzz.limits import slowness

CLOCK_TICKS = os.sysconf("SC_CLK_TCK")
LEAST_CPU_S = 1.0
"""CPU of an orderly end where :func:`slowness` is 1; PyTorch takes more than twice as much to load."""


@dataclass(frozen=True)
class Ending:
    """How a program ended that was interrupted."""

    code: int
    said: str
    cpu_s: float  # of it and its children, since the interrupt

    @property
    def is_at_once(self) -> bool:
        """Whether it did little more; told by its CPU, as a busy machine takes any time."""
        return self.cpu_s < LEAST_CPU_S * slowness()


def interrupted(
    words: Sequence[str], is_time: Callable[[int], bool], said: Path, environment: Mapping[str, str] = os.environ
) -> Ending:
    """Start a program, interrupt it once ``is_time`` of its process id, and wait for its end; ``said`` takes its words.

    Its children must end with it, and no other child of this process meanwhile.
    """
    with said.open("wb") as output:
        process = subprocess.Popen(
            words,
            stdout=output,
            stderr=subprocess.STDOUT,
            env=environment,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # whoever runs tests may ignore it
        )
    while process.poll() is None and not is_time(process.pid):
        time.sleep(0.01)
    ended_before_s = _cpu_of_ended_s()
    before_s = sum(_cpu_s(number) for number in (process.pid, *children(process.pid)))
    process.send_signal(signal.SIGINT)
    code = process.wait(timeout=240)
    return Ending(code, said.read_text("utf-8", "replace"), _cpu_of_ended_s() - ended_before_s - before_s)


def has_loaded(pid: int, library: str) -> bool:
    """Whether a process, or a child of it, has loaded a shared library with such a name."""
    return any(library in Path(f"/proc/{number}/maps").read_text() for number in (pid, *children(pid)))


def children(pid: int) -> dict[int, str]:
    """Processes that the main thread of a process has started, with their command lines."""
    numbers = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return {int(number): Path(f"/proc/{number}/cmdline").read_text() for number in numbers}


def _cpu_s(pid: int) -> float:
    """Seconds of CPU of a process and its ended children."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2].split()
    return sum(map(int, fields[11:15])) / CLOCK_TICKS


def _cpu_of_ended_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
