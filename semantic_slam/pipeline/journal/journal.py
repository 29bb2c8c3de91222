"""Journal on disk of what a hypothesis manager received, by which a restarted one replays and continues the run.

A belief is a function of the configuration, the received messages in order, and the backends' answers. A record is its
number, two lengths and a checksum, followed by its name and data. It is passed to the operating system at once, and
reaches the disk with :meth:`Journal.sync`. A record torn by a power cut is truncated at the next start.
"""

import fcntl
import os
import struct
import sys
import zlib
from pathlib import Path
from typing import NamedTuple

from semantic_slam.errors import InputError

FILE, OLD_FILE = "journal", "journal.old"
RUN = "run"
"""Name of the first record, whose data identify the run."""
HEADER = struct.Struct("<QIII")
"""Record number, length [bytes] of its name and of its data, CRC-32 over these three, name and data."""
NUMBERS = struct.Struct("<QII")


class Record(NamedTuple):
    """One journal entry."""

    name: str
    data: bytes


class NoJournal:
    """Null journal: it is empty and discards what is appended."""

    @property
    def next(self) -> Record | None:
        """The oldest record not taken yet; None if all were taken."""
        return None

    def take(self) -> Record:
        """Take the oldest record not taken yet. Raises InputError if there is none."""
        raise InputError("there is no journal to go on from; set parameter journal")

    def append(self, name: str, data: bytes = b"") -> None:
        """Append a record; all records on disk must have been taken before."""

    def sync(self) -> None:
        """Flush appended records to disk, so that they survive a power cut."""


class Journal(NoJournal):
    """Journal of one run in a folder, locked by one process at a time."""

    def __init__(self, folder: Path, run: str, *, resume: bool = True) -> None:
        """``run`` identifies the run; ``resume`` False: rename an old journal to journal.old. Raises InputError."""
        self._path = folder / FILE
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
            self._claim()
            if not resume and os.fstat(self._file).st_size:
                self._set_aside(folder / OLD_FILE)
        except OSError as fault:
            raise InputError(f"{self._path}: cannot be written ({fault.strerror}); name another journal") from None
        self._reader = self._path.open("rb")
        self._number = 0
        try:
            self._next = self._read()
            self._begin(run)
        except InputError:
            self.close()
            raise

    def _claim(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(f"{self._path}: another process goes on from it; end that one first") from None

    def _set_aside(self, place: Path) -> None:
        os.replace(self._path, place)
        os.close(self._file)
        self._file = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
        self._claim()

    def _begin(self, run: str) -> None:
        if self._next is None:
            self.append(RUN, run.encode())
            return
        first = self.take()
        if first != Record(RUN, run.encode()):
            raise InputError(
                f"{self._path}: is of another run (its configuration, map, input or version differ); name another"
                " journal, or remove this one"
            )

    @property
    def next(self) -> Record | None:
        return self._next

    def take(self) -> Record:
        record = self._next
        if record is None:
            raise InputError(f"{self._path}: ends too early; remove it and run again")
        self._next = self._read()
        return record

    def append(self, name: str, data: bytes = b"") -> None:
        if self._next is not None:
            raise ValueError(f"{self._path}: {name} was appended before all records were taken")
        word = name.encode()
        content = NUMBERS.pack(self._number, len(word), len(data)) + word + data
        head, body = content[: NUMBERS.size], content[NUMBERS.size :]
        self._write(head + struct.pack("<I", zlib.crc32(content)) + body)
        self._number += 1

    def _write(self, record: bytes) -> None:
        left = memoryview(record)
        while left:
            left = left[os.write(self._file, left) :]

    def sync(self) -> None:
        os.fdatasync(self._file)

    def close(self) -> None:
        """Close the file and release the lock."""
        self._reader.close()
        os.close(self._file)

    def _read(self) -> Record | None:
        """Read the next record; None at the end, where a torn record is truncated."""
        begin = self._reader.tell()
        head = self._reader.read(HEADER.size)
        if len(head) == HEADER.size:
            number, name_size, data_size, checksum = HEADER.unpack(head)
            left = os.fstat(self._file).st_size - begin - HEADER.size
            content = self._reader.read(name_size + data_size) if name_size + data_size <= left else b""
            whole = head[: NUMBERS.size] + content
            if number == self._number and len(content) == name_size + data_size and zlib.crc32(whole) == checksum:
                self._number += 1
                return Record(content[:name_size].decode("utf-8", "replace"), content[name_size:])
        self._cut_off(begin)
        return None

    def _cut_off(self, begin: int) -> None:
        torn = os.fstat(self._file).st_size - begin
        if torn:
            print(f"{self._path}: its last {torn} bytes are torn; they are cut off", file=sys.stderr)
            os.ftruncate(self._file, begin)
