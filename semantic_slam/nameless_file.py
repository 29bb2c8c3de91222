"""A file without a name: what a process keeps on disk and nobody is to find; gone with it, however it ends."""

import os
from functools import cached_property
from tempfile import TemporaryFile


class NamelessFile:
    """Bytes that are appended on one thread, and may be read on another, or by another process, up to ``length``."""

    def __init__(self) -> None:
        self.length = 0  # bytes of what was appended whole

    @cached_property
    def descriptor(self) -> int:
        """Descriptor of the file, which is there once somebody asks. Raises OSError."""
        with TemporaryFile(buffering=0) as file:
            return os.dup(file.fileno())

    def __del__(self) -> None:
        if "descriptor" in self.__dict__:
            os.close(self.descriptor)

    def append(self, data: bytes) -> None:
        """Append all of it, or none that counts. Raises OSError, as on a disk that takes no more."""
        left, at = memoryview(data), self.length
        while left:
            written = os.pwrite(self.descriptor, left, at)
            left, at = left[written:], at + written
        self.length = at

    def read(self, size: int, at: int) -> bytes:
        """So many bytes from ``at`` on, fewer where the file ends before."""
        return read(self.descriptor, size, at)


def read(descriptor: int, size: int, at: int) -> bytes:
    """So many bytes of an open file from ``at`` on, fewer where it ends before. Raises OSError."""
    data = b""
    while len(data) < size:
        part = os.pread(descriptor, size - len(data), at + len(data))
        if not part:
            break
        data += part
    return data
