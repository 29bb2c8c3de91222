"""What processes that were killed leave of Fast DDS in shared memory, and nobody else removes.

One that dies in the midst of making a port leaves it half made: whoever opens that port afterwards waits for ever, in
a call that nothing interrupts. Segments are half a megabyte of memory each.
"""

import fcntl
import os
import re
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

FOLDER = Path("/dev/shm")  # where POSIX has shared memory on Linux; nothing is written there
PORT = re.compile(r"fastrtps_port\d+")
LOCK = re.compile(r"fastrtps_[0-9a-f]{16}_el")
"""Held locked by the process that has the segment of the name before ``_el``, while it lives."""
MADE = (2).to_bytes(4, "little")
"""How Boost.Interprocess begins a segment that is ready."""
SETTLED_S = 2.0
"""To make a port or a lock takes microseconds."""


def remove_remains(folder: Path = FOLDER) -> None:
    """Remove what no process has that is alive; call it before rclpy makes a node. Takes ``SETTLED_S`` at most."""
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
    """Ports that are half made yet once they are so old that nobody makes them any more."""
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
    """Whether nobody holds a lock."""
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
