"""Sequential reading of the data section of an mcap, up to its damage; needs no index, footer or complete last chunk.

A record is an opcode (1 byte), a length (8 bytes) and the content. Recorders that write chunks put all schemas,
channels and messages into them, and indexes of their messages after each. What contradicts that is damage, as is what
differs from a checksum: a flipped bit may make a record pass for one of another kind.
"""

import struct
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple
from zlib import crc32

from mcap.opcode import Opcode

from semantic_slam.bag.chunk_limits import RECORD_HEADER
from semantic_slam.bag.mcap_chunk import CUT_OFF, unpacked
from semantic_slam.errors import InputError

MAGIC = b"\x89MCAP0\r\n"
INDEX_HEADER = struct.Struct("<HI")  # channel, size of the entries
INDEX_ENTRY_SIZE = 16
FIRST_PRIVATE = 0x80
"""Opcodes from here on belong to applications."""
CHANNEL_ID_SIZE = 2
_OF_CHUNKS = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
_BESIDE_CHUNKS = (Opcode.HEADER, Opcode.ATTACHMENT, Opcode.METADATA)


class Record(NamedTuple):
    """One schema, channel or message."""

    opcode: int
    content: bytes


class McapRecords:
    """One pass over the data section of an mcap; its attributes hold for what was read."""

    def __init__(self, path: Path) -> None:
        """Raise InputError when the file is no mcap."""
        self._path = path
        self.damage = ""  # what ended the reading, and where
        self.is_torn = False  # the damage is no more than that the file ends in the midst of what was written last
        self.has_end = False  # the data section was closed by its recorder
        self.has_checksums = True
        self._crc = crc32(MAGIC)
        self._indexed: Counter[int] | None = None  # messages by channel of the chunk just before; None: no chunk there
        self._has_chunks = False
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise InputError(f"{path}: no mcap file; give a rosbag2 folder, a .mcap or a .db3")

    def __iter__(self) -> Iterator[Record]:
        """The complete records before the damage, those in chunks included."""
        size = self._path.stat().st_size
        with self._path.open("rb") as file:
            file.seek(len(MAGIC))
            while not (self.damage or self.has_end) and (place := file.tell()) < size:
                yield from self._next(file, place, size)

    def _next(self, file: BinaryIO, place: int, size: int) -> Iterator[Record]:
        header = file.read(RECORD_HEADER.size)
        if len(header) < RECORD_HEADER.size:
            self._break_off(f"the record at byte {place}", is_torn=True)
            return
        opcode, length = RECORD_HEADER.unpack(header)
        content = file.read(min(length, size))
        is_cut = len(content) < length
        if opcode == Opcode.CHUNK:
            yield from self._chunk(content, place, is_cut)
        elif opcode == Opcode.MESSAGE_INDEX:
            self._check_index(content, place, is_cut)
        elif is_cut:
            self._break_off(f"the record at byte {place}", is_torn=False)
        elif opcode == Opcode.DATA_END:
            self._end(content)
        else:
            yield from self._other(opcode, content, place)
        self._crc = crc32(content, crc32(header, self._crc))

    def _chunk(self, content: bytes, place: int, is_cut: bool) -> Iterator[Record]:
        records, damage, has_checksum = unpacked(content, is_cut=is_cut)
        self.has_checksums &= has_checksum or not records
        self._has_chunks, self._indexed = True, Counter()
        start = 0
        while (begin := start + RECORD_HEADER.size) <= len(records):
            opcode, length = RECORD_HEADER.unpack_from(records, start)
            if begin + length > len(records):
                break
            start = begin + length
            if opcode == Opcode.MESSAGE:
                self._indexed[int.from_bytes(records[begin : begin + CHANNEL_ID_SIZE], "little")] += 1
            if opcode in _OF_CHUNKS:
                yield Record(opcode, records[begin:start])
        if damage == CUT_OFF:
            self._break_off(f"the chunk at byte {place}", is_torn=is_cut)
        elif damage or is_cut or start < len(records):
            self.damage = f"the chunk at byte {place} {damage or 'does not end with a record'}"

    def _check_index(self, content: bytes, place: int, is_cut: bool) -> None:
        channel, size = INDEX_HEADER.unpack(content[: INDEX_HEADER.size].ljust(INDEX_HEADER.size, b"\0"))
        if is_cut and len(content) < INDEX_HEADER.size + size:
            self._break_off(f"the index at byte {place}", is_torn=True)
            return
        told = None if self._indexed is None else INDEX_ENTRY_SIZE * self._indexed[channel]
        if size != told or len(content) != INDEX_HEADER.size + size:
            self.damage = f"the index at byte {place} does not fit the chunk before it"

    def _end(self, content: bytes) -> None:
        self.has_end = True
        if (crc := int.from_bytes(content, "little")) not in (0, self._crc):
            self.damage = f"the data up to their end do not fit their checksum {crc:08x}"

    def _other(self, opcode: int, content: bytes, place: int) -> Iterator[Record]:
        self._indexed = None
        if opcode in _OF_CHUNKS and not self._has_chunks:
            self.has_checksums = False
            yield Record(opcode, content)
        elif opcode not in _BESIDE_CHUNKS and opcode < FIRST_PRIVATE:
            self.damage = f"the record at byte {place} is none that stands there"

    def _break_off(self, what: str, *, is_torn: bool) -> None:
        self.damage, self.is_torn = f"{what} {CUT_OFF}", is_torn
