"""File of a journal: records in order, each with its number, two lengths and a checksum, followed by name and data.

Numbers go on from one file of a journal to the next, so that a file that is missing in between is noticed.
"""

import os
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from semantic_slam.nameless_file import read

HEADER = struct.Struct("<QIII")
"""Record number, length [bytes] of its name and of its data, CRC-32 over these three, name and data."""
NUMBERS = struct.Struct("<QII")
CHECKSUM_SIZE = HEADER.size - NUMBERS.size
NUMBER_SIZE = 8
BLOCK = 1 << 20
"""Bytes that are searched for a record at once."""


class Record(NamedTuple):
    """One journal entry."""

    name: str
    data: bytes


class Segment:
    """An append-only file of records; ``number`` is that of the next record to be read or, after all, appended."""

    def __init__(self, path: Path) -> None:
        """Open a file, or create an empty one. Raises OSError."""
        self.path = path
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
        self._at = 0  # bytes that were read or appended
        head = os.pread(self._file, HEADER.size, 0)
        self.number = int(HEADER.unpack(head)[0]) if len(head) == HEADER.size else 0

    @property
    def size(self) -> int:
        """Length of the file [bytes]."""
        return os.fstat(self._file).st_size

    @property
    def num_read(self) -> int:
        """Bytes of the records that were read or appended."""
        return self._at

    @property
    def num_torn(self) -> int:
        """Bytes behind the records that were read; after the last whole one, those of a torn record."""
        return self.size - self._at

    @staticmethod
    def size_of(name: str, data: bytes) -> int:
        """Length of a record in the file [bytes]."""
        return HEADER.size + len(name.encode()) + len(data)

    def read(self) -> Record | None:
        """Read the next record; None where none is whole."""
        record = self._record_at(self._at, self.number)
        if record is not None:
            self.number += 1
            self._at += self.size_of(*record)
        return record

    def _record_at(self, at: int, number: int) -> Record | None:
        """The whole record with this number at a place in the file; None if there is none."""
        head = os.pread(self._file, HEADER.size, at)
        if len(head) < HEADER.size:
            return None
        told, name_size, data_size, checksum = HEADER.unpack(head)
        length = name_size + data_size
        content = read(self._file, length, at + HEADER.size) if length <= self.size - at - HEADER.size else None
        if content is None or told != number or zlib.crc32(head[: NUMBERS.size] + content) != checksum:
            return None
        return Record(content[:name_size].decode("utf-8", "replace"), content[name_size:])

    @property
    def is_damaged(self) -> bool:
        """Whether a later record is whole behind one that is not, so that the end of the file was not just torn off."""
        numbers = range(self.number + 1, self.number + 1 + self.num_torn // HEADER.size)
        for start in range(self._at + 1, self.size, BLOCK):
            block = read(self._file, BLOCK + NUMBERS.size, start)
            if any(self._record_at(start + at, number) is not None for at, number in _found(block, numbers)):
                return True
        return False

    def cut_off(self) -> None:
        """Remove what is behind the records that were read."""
        os.ftruncate(self._file, self._at)

    def append(self, name: str, data: bytes) -> None:
        """Append a record. Raises OSError."""
        word = name.encode()
        content = NUMBERS.pack(self.number, len(word), len(data)) + word + data
        head, body = content[: NUMBERS.size], content[NUMBERS.size :]
        left = memoryview(head + struct.pack("<I", zlib.crc32(content)) + body)
        while left:
            left = left[os.write(self._file, left) :]
        self.number += 1
        self._at += len(content) + CHECKSUM_SIZE

    def sync(self) -> None:
        """Flush appended records to disk."""
        os.fdatasync(self._file)

    def move_to(self, path: Path) -> None:
        """Rename the file, in place of another one. Raises OSError."""
        os.replace(self.path, path)
        self.path = path

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)


def _found(block: bytes, numbers: range) -> Iterator[tuple[int, int]]:
    """Places in ``block`` that state one of these record numbers, with the number."""
    for shift in range(min(NUMBER_SIZE, len(block) - NUMBER_SIZE + 1)):
        told = np.frombuffer(block, "<u8", (len(block) - shift) // NUMBER_SIZE, shift)
        for index in np.flatnonzero((told >= numbers.start) & (told < numbers.stop)):
            yield shift + NUMBER_SIZE * int(index), int(told[index])


def sync_folder(folder: Path) -> None:
    """Flush to disk which files are in a folder, under which names."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
