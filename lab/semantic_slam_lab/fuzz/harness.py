"""Runs cases until the time is over, each in a worker that may die, and tells what was found."""

import argparse
import multiprocessing
import os
import sys
import time
import traceback
import zlib
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp

import numpy as np

from semantic_slam.cli.exit_codes import CommandParser
from semantic_slam.errors import SemanticSlamError
from semantic_slam_lab.fuzz.limits import bound_address_space, limited
from semantic_slam_lab.fuzz.results import Finding, Fuzzed, write_fuzzed

HANG_S = 90.0
"""A worker that tells nothing for so long is stuck outside Python, unless it waits for its turn on a busy machine."""
RUNNABLE = "R"
"""State of a process that runs, or would if it were its turn."""
Case = Callable[[np.random.Generator], None]
Target = Callable[[Path], Case]
"""Makes, once per worker, a function that draws one case and feeds it to a real reader; the folder is for files."""


def parse(targets: dict[str, Target]) -> argparse.Namespace:
    """Arguments of the command line; raises InputError."""
    parser = CommandParser(
        description="Feed readers and the engine what nobody should send. The last line is 'N cases, M findings'."
    )
    parser.add_argument("--seconds", type=float, default=120.0, help="how long (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="seed of every draw (default: %(default)s)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: %(default)s)")
    parser.add_argument("--target", choices=sorted(targets), action="append", help="these alone; may be repeated")
    parser.add_argument("--index", type=int, help="one case of one target again, with its whole traceback")
    parser.add_argument("--live", action="store_true", help="forge messages of a demo that runs, instead")
    parser.add_argument("--messages", type=int, default=2000, help="forgeries of --live (default: %(default)s)")
    parser.add_argument("--bag", type=Path, default=Path("bags/aliased_room"), help="bag of --live")
    parser.add_argument("--config", type=Path, default=Path("config/default.yaml"), help="configuration of --live")
    parser.add_argument("--out", type=Path, help="folder for result.json and a page; none without")
    return parser.parse_args()


def run(targets: dict[str, Target], arguments: argparse.Namespace) -> int:
    """All workers until the time is over and the cases that they are at then have ended: the exit code."""
    chosen = {name: targets[name] for name in arguments.target or targets}
    if arguments.index is not None:
        return _again(chosen, arguments)
    with TemporaryDirectory(prefix="fuzz_") as folder:
        found = _all_work(chosen, arguments, Path(folder))
    for line in found.lines:
        print(line)
    if arguments.out is not None:
        write_fuzzed(arguments.out, found, arguments.seed, arguments.seconds)
    print(f"{found.num_cases} cases, {len(found.findings)} findings")
    return 1 if found.findings or not found.num_cases else 0


def _all_work(targets: dict[str, Target], arguments: argparse.Namespace, folder: Path) -> Fuzzed:
    """What workers have begun in the time, and what they have found."""
    give_up = time.monotonic() + arguments.seconds
    workers = [Worker(targets, arguments.seed, number, arguments.jobs, folder) for number in range(arguments.jobs)]
    found = Fuzzed()
    try:
        while time.monotonic() < give_up:
            for worker in workers:
                found.note_all(worker.poll(0.2))
        for worker in workers:
            found.note_all(worker.last())
    finally:
        for worker in workers:
            worker.stop()
    return found


class Worker:
    """A process that runs every ``jobs``-th case; started anew where it dies or hangs.

    Each start has a new folder in ``folder``, which its maker removes: a process that is killed removes nothing.
    """

    def __init__(self, targets: dict[str, Target], seed: int, number: int, jobs: int, folder: Path) -> None:
        self._targets, self._seed, self._jobs, self._folder = targets, seed, jobs, folder
        self._next = number
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("fork")
        self._pipe, theirs = context.Pipe(duplex=False)
        own = Path(mkdtemp(dir=self._folder))
        arguments = (self._targets, self._seed, self._next, self._jobs, own, theirs)
        self._process = context.Process(target=_work, args=arguments, daemon=True)
        self._process.start()
        self._last_s, self._used_s = time.monotonic(), 0.0
        theirs.close()

    def poll(self, patience_s: float) -> Iterator[tuple[str, Finding | None]]:
        """Targets of the cases run since the last call, and what became of each: None, or what was found."""
        try:
            while self._pipe.poll(patience_s):
                number, finding = self._pipe.recv()
                self._next, patience_s = number + self._jobs, 0.0
                self._last_s, self._used_s = time.monotonic(), process_state(self._process.pid)[1]
                yield _place(self._targets, number)[0], finding
        except EOFError:
            self._process.join()
            yield self._died(f"the process died with {self._process.exitcode}")
            return
        if self._is_stuck():
            self._process.kill()
            self._process.join()
            yield self._died(f"nothing for {HANG_S:.0f} s")

    def _is_stuck(self) -> bool:
        if time.monotonic() - self._last_s <= HANG_S:
            return False
        state, used_s = process_state(self._process.pid)
        return state != RUNNABLE or used_s - self._used_s > HANG_S / 2

    def last(self) -> Iterator[tuple[str, Finding | None]]:
        """Results of :meth:`poll` until the current case has ended or hangs."""
        yield from self.poll(0.0)
        told = False
        while not told:
            for place in self.poll(0.2):
                told = True
                yield place

    def _died(self, what: str) -> tuple[str, Finding]:
        name, index = _place(self._targets, self._next)
        self._next += self._jobs
        self._start()
        return name, Finding(target=name, index=index, what=what, where="?")

    def stop(self) -> None:
        self._process.kill()
        self._process.join()


def process_state(pid: int | None) -> tuple[str, float]:
    """State of a process as the kernel names it, and the seconds of CPU that it has used; ("", 0) once it is gone."""
    try:
        told = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    except OSError:
        return "", 0.0
    return told[0], sum(int(ticks) for ticks in told[11:13]) / os.sysconf("SC_CLK_TCK")


def _place(targets: dict[str, Target], number: int) -> tuple[str, int]:
    """Target and index of the case with that number: targets take turns."""
    return list(targets)[number % len(targets)], number // len(targets)


def _work(targets: dict[str, Target], seed: int, first: int, jobs: int, folder: Path, pipe: Connection) -> None:
    with open("/dev/null", "w", encoding="ascii") as nowhere:
        for stream in (sys.stdout, sys.stderr):  # what libraries in C print, too
            os.dup2(nowhere.fileno(), stream.fileno())
        made: dict[str, Case] = {}
        number = first
        while True:
            name, index = _place(targets, number)
            if name not in made:
                made[name] = targets[name](folder)
            bound_address_space()
            pipe.send((number, outcome(name, made[name], seed, index)))
            number += jobs


def outcome(name: str, case: Case, seed: int, index: int) -> Finding | None:
    """What became of one case: None where it ended well or with an error of ours."""
    chance = np.random.default_rng([seed, zlib.crc32(name.encode()), index])
    try:
        with limited():
            case(chance)
    except SemanticSlamError as fault:
        return _line_finding(name, index, str(fault))
    except BaseException as fault:
        lines = traceback.extract_tb(fault.__traceback__)
        ours = [frame for frame in lines if "semantic_slam" in frame.filename and "/fuzz/" not in frame.filename]
        where = f"{Path(ours[-1].filename).name}:{ours[-1].lineno}" if ours else "?"
        what = " ".join(f"{type(fault).__name__}: {fault}".split())[:200]
        return Finding(target=name, index=index, what=what, where=where, trace=traceback.format_exc())
    return None


def _line_finding(name: str, index: int, text: str) -> Finding | None:
    """Errors of ours are one short line."""
    if "\n" not in text.strip() and len(text) <= LONGEST_LINE:
        return None
    return Finding(target=name, index=index, what=f"a message of {len(text)} characters: {text[:80]!r}", where="?")


LONGEST_LINE = 2000


def _again(chosen: dict[str, Target], arguments: argparse.Namespace) -> int:
    (name,) = chosen
    with TemporaryDirectory(prefix="fuzz_") as folder:
        finding = outcome(name, chosen[name](Path(folder)), arguments.seed, arguments.index)
    if finding is not None:
        print(finding.trace or finding.what)
    print(f"1 cases, {int(finding is not None)} findings")
    return int(finding is not None)
