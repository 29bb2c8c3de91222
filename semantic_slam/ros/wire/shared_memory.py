"""Removes Fast DDS files in shared memory that killed processes have left behind.

A process killed while it creates a port leaves the port incomplete: any process that opens it later blocks forever, in
a call that cannot be interrupted. Orphaned segments take half a megabyte of memory each.
"""

import fcntl
import os
import re
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

FOLDER = Path("/dev/shm")  # POSIX shared memory on Linux; files are only removed there
PORT = re.compile(r"fastrtps_port\d+")
LOCK = re.compile(r"fastrtps_[0-9a-f]{16}_el")
"""Lock file that a living process holds for its segment, whose name is that before ``_el``."""
MADE = (2).to_bytes(4, "little")
"""First bytes of a fully initialised Boost.Interprocess segment."""
SETTLED_S = 2.0
"""Age after which a port or a lock is certainly complete; creating one takes microseconds."""


def remove_remains(folder: Path = FOLDER) -> None:
    """Remove own files that no living process uses; call it before creating a node. Takes ``SETTLED_S`` at most."""
    if not folder.is_dir():
        return
    mine = [entry.name for entry in os.scandir(folder) if _is_mine(entry)]
    for name in filter(LOCK.fullmatch, mine):
        if _age_s(folder / name) > SETTLED_S and _is_free(folder / name):
            _remove(folder, (name.removesuffix("_el"), name))
    half = [name for name in filter(PORT.fullmatch, mine) if _is_half_made(folder / name)]
    for name in _settled(folder, half):
        _remove(folder, (name,))


def _settled(folder: Path, names: list[str]) -> Iterator[str]:
    """The ports that are still incomplete at an age of ``SETTLED_S``."""
    for name in names:
        time.sleep(max(0.0, min(SETTLED_S - _age_s(folder / name), SETTLED_S)))
        if _is_half_made(folder / name):
            yield name


def _is_mine(entry: os.DirEntry[str]) -> bool:
    with suppress(OSError):
        return entry.name.startswith("fastrtps_") and entry.stat().st_uid == os.getuid()
    return False


def _is_half_made(port: Path) -> bool:
    try:
        with port.open("rb") as content:
            return content.read(len(MADE)) != MADE
    except OSError:
        return False


def _is_free(lock: Path) -> bool:
    """Whether no process holds a lock."""
    try:
        with lock.open("rb") as content:
            fcntl.flock(content, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
    except OSError:
        return False


def _age_s(path: Path) -> float:
    with suppress(OSError):
        return time.time() - path.stat().st_mtime
    return 0.0


def _remove(folder: Path, names: tuple[str, ...]) -> None:
    for name in names:
        (folder / name).unlink(missing_ok=True)
