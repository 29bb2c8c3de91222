"""Reports of many bags, each in a separate process, and a page that compares them.

The failure of one bag, by bad input, a crash or lack of memory, does not affect the others.
"""

import os
import subprocess
import sys
from argparse import Namespace
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from semantic_slam.cli.exit_codes import DONE, FAULT
from semantic_slam.errors import InputError
from semantic_slam.outputs import check_output, write_whole

THREADS = "OMP_NUM_THREADS"


@dataclass(frozen=True)
class Ended:
    """How a bag's process ended."""

    code: int
    words: str  # its stderr


def report_many(arguments: Namespace) -> list[Path]:
    """Write a report for each of ``arguments.bags``, in a folder named after it, and a summary; returns its files.

    Raises InputError; for bags that failed, after all others are done.
    """
    from semantic_slam.report.summary import summary_files, summary_row

    out: Path = arguments.out
    bags = names_of(arguments.bags)
    for name in ("index.html", "summary.json"):
        check_output(out / name, overwrite=arguments.overwrite)
    commands = {name: _words(arguments, bag, out / name) for name, bag in bags.items()}
    before = {name: _version(out / name) for name in bags}
    out.mkdir(parents=True, exist_ok=True)
    ended = _run_all(commands, arguments.jobs, arguments.scheduler)
    faults = {name: _fault(ended[name]) for name in bags}
    written = {name: out / name for name in bags if _version(out / name) != before[name]}
    files = summary_files([summary_row(name, bag, written.get(name), faults[name]) for name, bag in bags.items()])
    for file, text in files.items():
        write_whole(out / file, text)
    failed = [name for name in bags if faults[name]]
    for name in failed:
        print(f"{name}: {faults[name]}", file=sys.stderr)
    if failed:
        raise InputError(f"{len(failed)} of {len(bags)} bags went wrong: {', '.join(failed)}; see {out / 'index.html'}")
    return [out / file for file in files]


def names_of(bags: Sequence[Path]) -> dict[str, Path]:
    """Bags by the name of their report folder: the bag's name, prefixed by its parent folder if it is not unique.

    Raises InputError if the names are still not unique.
    """
    short = [_own_name(bag.resolve()) for bag in bags]
    often = Counter(short)
    names = [
        name if often[name] == 1 else f"{bag.resolve().parent.name}_{name}"
        for name, bag in zip(short, bags, strict=True)
    ]
    twice = sorted(name for name, count in Counter(names).items() if count > 1)
    if twice:
        raise InputError(f"{twice[0]}: two bags would share this report folder; report them by separate commands")
    return dict(zip(names, bags, strict=True))


def _version(folder: Path) -> int | None:
    """Modification time [ns] of the report in a folder, to detect whether a run wrote it; None if there is none."""
    report = folder / "report.json"
    return report.stat().st_mtime_ns if report.is_file() else None


def _own_name(bag: Path) -> str:
    return bag.stem if bag.suffix in (".mcap", ".db3") else bag.name


def _words(arguments: Namespace, bag: Path, out: Path) -> list[str]:
    """Command line arguments for one bag, which runs in one process unless ``--processes`` says otherwise."""
    words = [str(bag.resolve()), "--out", str(out.resolve()), "--processes", str(arguments.processes or 1)]
    for flag in ("config", "seed", "max_keyframes", "map_prior"):
        value = getattr(arguments, flag)
        if value is not None:
            words += [f"--{flag.replace('_', '-')}", str(value.resolve() if isinstance(value, Path) else value)]
    for configuration in arguments.compare or []:
        words += ["--compare", str(configuration.resolve())]
    return [*words, *(["--explain"] if arguments.explain else []), *(["--overwrite"] if arguments.overwrite else [])]


def _run_all(commands: Mapping[str, list[str]], jobs: int, scheduler: str | None) -> dict[str, Ended]:
    from tqdm import tqdm

    threads = str(max(1, (os.cpu_count() or 1) // jobs)) if scheduler is None else "1"
    with _executor(jobs, scheduler) as executor:
        futures = {executor.submit(_report_one, words, threads): name for name, words in commands.items()}
        done = tqdm(as_completed(futures), total=len(futures), desc="bags")
        return {futures[future]: _ended(future) for future in done}


def _ended(future: Future[Ended]) -> Ended:
    """How a bag's process ended; an exception means that the cluster lost it."""
    fault = future.exception()
    return future.result() if fault is None else Ended(FAULT, f"the cluster lost it ({fault!r})")


@contextmanager
def _executor(jobs: int, scheduler: str | None) -> Iterator[Executor]:
    """Executor: threads that each wait for a process, or the Dask cluster at ``scheduler``. Raises InputError."""
    if scheduler is None:
        with ThreadPoolExecutor(jobs) as threads:
            try:
                yield threads
            except BaseException:  # Ctrl-C: cancel the bags that have not started
                threads.shutdown(wait=False, cancel_futures=True)
                raise
        return
    from semantic_slam.cluster import connected

    with connected(scheduler) as client, client.get_executor() as executor:
        yield executor


def _report_one(words: list[str], threads: str) -> Ended:
    environment = {THREADS: threads, **os.environ}
    command = [sys.executable, "-m", "semantic_slam.cli.bag_to_report", *words]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, errors="replace", check=False)
    return Ended(done.returncode, done.stderr)


def _fault(ended: Ended) -> str:
    """Error text of a failed process: its signal, or its last line on stderr; "" if it succeeded."""
    if ended.code == DONE:
        return ""
    lines = [line.strip() for line in ended.words.splitlines() if line.strip()]
    if ended.code < 0:
        return f"ended by signal {-ended.code}"
    return lines[-1] if lines else f"ended with exit code {ended.code}"
