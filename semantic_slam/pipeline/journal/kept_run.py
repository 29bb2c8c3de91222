"""Keeps the keyframes of the current run in an unnamed file, for late backends and for repeating the inference.

Another process can read it by its descriptor, up to the length at the time of the request.
"""

import struct
from array import array
from collections.abc import Iterator

from semantic_slam.errors import InputError
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode, encode
from semantic_slam.nameless_file import NamelessFile, read

LENGTH = struct.Struct("<Q")


class KeptRun:
    """Configuration and keyframes of a run, kept in a file until the object is no longer referenced."""

    def __init__(self, run: RunConfiguration) -> None:
        self.fault = ""  # why keyframes are missing; "" if none are
        self._file = NamelessFile()
        self._run_id = run.run_id
        self._append(encode(run))
        self._ends = array("Q", [self.length])  # end offsets [bytes] of the configuration and of each keyframe

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
        return len(self._ends) - 1

    def add(self, keyframe: Keyframe) -> None:
        """Keep the next keyframe; others are ignored. A disk error sets ``fault`` and stops the keeping."""
        if keyframe.index != self.num_keyframes:
            return
        self._append(encode(keyframe, run_id=self._run_id))
        if not self.fault:
            self._ends.append(self.length)

    def keyframes(self, first: int, end: int) -> list[Keyframe]:
        """Kept keyframes ``first`` to ``end`` - 1. Raises InputError or OSError if they cannot be read."""
        last = min(end, self.num_keyframes)
        if first >= last:
            return []
        kind = topics.TYPES[topics.KEYFRAMES]
        return [decode(data, kind) for data in _records(self.descriptor, self._ends[first], self._ends[last])]

    def _append(self, data: bytes) -> None:
        if self.fault:
            return
        try:
            self._file.append(LENGTH.pack(len(data)) + data)
        except OSError as fault:
            reason = f"the keyframes of this run could not be kept ({fault.strerror})"
            self.fault = f"{reason}; have TMPDIR name a folder that takes them"


def read_kept(descriptor: int, length: int) -> tuple[RunConfiguration, list[Keyframe]]:
    """Read configuration and keyframes from the first ``length`` bytes of a file. Raises InputError or OSError."""
    run, *keyframes = _records(descriptor, 0, length)
    types = topics.TYPES
    return decode(run, types[topics.RUN_CONFIGURATION]), [decode(own, types[topics.KEYFRAMES]) for own in keyframes]


def _records(descriptor: int, at: int, end: int) -> Iterator[bytes]:
    while at < end:
        (size,) = LENGTH.unpack(_read(descriptor, LENGTH.size, at))
        yield _read(descriptor, size, at + LENGTH.size)
        at += LENGTH.size + size


def _read(descriptor: int, size: int, at: int) -> bytes:
    data = read(descriptor, size, at)
    if len(data) < size:
        raise InputError("the keyframes that were kept end too early; record the belief bag and explain that")
    return data
