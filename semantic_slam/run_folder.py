"""Folder of a run on this host, in TMPDIR: private to the user, shared by the run's nodes, removed by the last of them.

Every node in it holds a lock, which the system releases however the node ends. A node that enters removes the folders
that nobody is in any more.
"""

import os
import shutil
import stat
from contextlib import suppress
from fcntl import LOCK_EX, LOCK_NB, LOCK_SH, flock
from pathlib import Path
from tempfile import gettempdir

ATTEMPTS = 10
"""Times to enter a folder that others remove in the same moment."""


class RunFolder:
    """A folder that this process is in until it leaves; ``fault``: the system's error message, if there is none."""

    def __init__(self, name: str) -> None:
        self.path, self.fault = Path(gettempdir()) / f"semantic_slam_{os.getuid()}" / name, ""
        self._descriptor: int | None = None
        try:
            _make_private(self.path.parent)
            self._descriptor = _entered(self.path)
            for other in self.path.parent.iterdir():
                _remove_where_left(other)
        except OSError as fault:
            self.fault = fault.strerror or str(fault)

    def leave(self) -> None:
        """Leave the folder, and remove it if no other node is in it."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None
            _remove_where_left(self.path)


def _make_private(folder: Path) -> None:
    """Make a folder that nobody else can write to. Raises OSError, as where it is another user's."""
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o077:
        raise PermissionError(f"{folder} is not private to this user")


def _entered(folder: Path) -> int:
    """Descriptor of a folder, locked against removal. Raises OSError."""
    for _ in range(ATTEMPTS):
        folder.mkdir(mode=0o700, exist_ok=True)
        with suppress(FileNotFoundError):
            descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
            flock(descriptor, LOCK_SH)
            if folder.exists() and os.path.samestat(folder.stat(), os.fstat(descriptor)):
                return descriptor
            os.close(descriptor)
    raise FileNotFoundError(f"{folder} is removed again and again")


def _remove_where_left(folder: Path) -> None:
    """Remove a folder if no node is in it."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            flock(descriptor, LOCK_EX | LOCK_NB)
            shutil.rmtree(folder, ignore_errors=True)
        finally:
            os.close(descriptor)
