"""Keeps the keyframes of the current run in a file, for late backends and for repeating the inference.

Another process can read it by its descriptor, up to the length at the time of the request. A record is its length, a
checksum, and a message: of the run's configuration, then of each keyframe.
"""

import os
import struct
import zlib
from array import array
from collections.abc import Iterator

from semantic_slam.errors import InputError
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode, encode
from semantic_slam.nameless_file import NamelessFile, read

HEADER = struct.Struct("<QI")
"""Length of a message [bytes], and its CRC-32."""


class KeptRun:
    """Configuration and keyframes of a run, kept in a file until the object is no longer referenced."""

    def __init__(self, run: RunConfiguration, file: NamelessFile | None = None) -> None:
        """``file`` may have the beginning of this run already; None: a nameless one."""
        self.fault = ""  # why keyframes are missing; "" if none are
        self._file = NamelessFile() if file is None else file
        self._run_id = run.run_id
        self._ends = array("Q")  # end offsets [bytes] of the configuration and of each keyframe
        if self.length:
            self._find_ends()
        else:
            self._append(encode(run))

    def _find_ends(self) -> None:
        at = 0
        while at < self.length:
            at += HEADER.size + HEADER.unpack(_read(self.descriptor, HEADER.size, at))[0]
            self._ends.append(at)

    @property
    def descriptor(self) -> int:
        """File descriptor; the file exists once the first record is written."""
        return self._file.descriptor

    @property
    def length(self) -> int:
        """Length [bytes] of the complete records."""
        return self._file.length

    @property
    def num_keyframes(self) -> int:
        """Number of keyframes kept, counted from the first."""
        return max(len(self._ends) - 1, 0)

    def add(self, keyframe: Keyframe) -> None:
        """Keep the next keyframe; others are ignored. A disk error sets ``fault`` and stops the keeping."""
        if keyframe.index == self.num_keyframes:
            self._append(encode(keyframe, run_id=self._run_id))

    def keyframes(self, first: int, end: int) -> list[Keyframe]:
        """Kept keyframes ``first`` to ``end`` - 1. Raises InputError or OSError if they cannot be read."""
        last = min(end, self.num_keyframes)
        if first >= last:
            return []
        kind = topics.TYPES[topics.KEYFRAMES]
        return [decode(data, kind) for data in _records(self.descriptor, self._ends[first], self._ends[last])]

    def sync(self) -> None:
        """Flush the records to disk. Raises OSError."""
        os.fdatasync(self.descriptor)

    def _append(self, data: bytes) -> None:
        if self.fault:
            return
        try:
            self._file.append(HEADER.pack(len(data), zlib.crc32(data)) + data)
        except OSError as fault:
            reason = f"the keyframes of this run could not be kept ({fault.strerror})"
            self.fault = f"{reason}; have TMPDIR name a folder that takes them"
        else:
            self._ends.append(self.length)


def read_kept(descriptor: int, length: int) -> tuple[RunConfiguration, list[Keyframe]]:
    """Read configuration and keyframes from the first ``length`` bytes of a file. Raises InputError or OSError."""
    run, *keyframes = _records(descriptor, 0, length)
    types = topics.TYPES
    return decode(run, types[topics.RUN_CONFIGURATION]), [decode(own, types[topics.KEYFRAMES]) for own in keyframes]


def _records(descriptor: int, at: int, end: int) -> Iterator[bytes]:
    while at < end:
        size, checksum = HEADER.unpack(_read(descriptor, HEADER.size, at))
        data = _read(descriptor, size, at + HEADER.size)
        if zlib.crc32(data) != checksum:
            raise InputError("the keyframes that were kept are damaged; record the belief bag and explain that")
        yield data
        at += HEADER.size + size


def _read(descriptor: int, size: int, at: int) -> bytes:
    data = read(descriptor, size, at)
    if len(data) < size:
        raise InputError("the keyframes that were kept end too early; record the belief bag and explain that")
    return data
