"""Unnamed temporary file: private disk storage of a process, freed when the process ends, however it ends."""

import os
from functools import cached_property
from tempfile import TemporaryFile


class NamelessFile:
    """Append-only bytes: one thread appends; other threads and processes may read up to ``length``."""

    def __init__(self) -> None:
        self.length = 0  # bytes that were appended completely

    @cached_property
    def descriptor(self) -> int:
        """File descriptor; the file is created on first access. Raises OSError."""
        with TemporaryFile(buffering=0) as file:
            return os.dup(file.fileno())

    def __del__(self) -> None:
        if "descriptor" in self.__dict__:
            os.close(self.descriptor)

    def append(self, data: bytes) -> None:
        """Append all of ``data``; a partial write is not counted in ``length``. Raises OSError, as on a full disk."""
        left, at = memoryview(data), self.length
        while left:
            written = os.pwrite(self.descriptor, left, at)
            left, at = left[written:], at + written
        self.length = at

    def read(self, size: int, at: int) -> bytes:
        """Read ``size`` bytes from offset ``at``, fewer where the file ends earlier."""
        return read(self.descriptor, size, at)


def read(descriptor: int, size: int, at: int) -> bytes:
    """Read ``size`` bytes of an open file from offset ``at``, fewer where it ends earlier. Raises OSError."""
    data = b""
    while len(data) < size:
        part = os.pread(descriptor, size - len(data), at + len(data))
        if not part:
            break
        data += part
    return data
