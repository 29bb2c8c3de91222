"""What a hypothesis manager received and was answered, record by record on disk, so that a restarted one goes on.

A belief is a function of the configuration, of what the manager took in its order, and of its backends' answers. A
record has its number, two lengths and a checksum before its name and data; it reaches the operating system at once,
and the disk with :meth:`Journal.sync`. What a power cut tore off the end is cut off at the next start.
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
"""The first record: what tells one run from another."""
HEADER = struct.Struct("<QIII")
"""Number of the record, bytes of its name and of its data, CRC-32 of these three, name and data."""
NUMBERS = struct.Struct("<QII")


class Record(NamedTuple):
    """One thing that happened."""

    name: str
    data: bytes


class NoJournal:
    """Nothing was kept, and nothing is."""

    @property
    def next(self) -> Record | None:
        """The oldest record that was not taken yet; None: all are."""
        return None

    def take(self) -> Record:
        """The oldest record that was not taken yet, which there has to be."""
        raise InputError("there is no journal to go on from; set parameter journal")

    def append(self, name: str, data: bytes = b"") -> None:
        """Keep what happened now; all that is on disk has to be taken before."""

    def sync(self) -> None:
        """Whatever was appended outlives a power cut from now on."""


class Journal(NoJournal):
    """The journal of one run in a folder; one process holds it at a time."""

    def __init__(self, folder: Path, run: str, *, resume: bool = True) -> None:
        """``run`` tells the run from others; without ``resume`` an old journal is set aside. Raises InputError."""
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
        """Let another process go on."""
        self._reader.close()
        os.close(self._file)

    def _read(self) -> Record | None:
        """The next record; None at the end, where what is torn is cut off."""
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
