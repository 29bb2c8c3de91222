"""Checksums of mcap files: CRC-32 of each chunk, of the summary with its index, and of the data before it.

A checksum of 0 says that none was written.
"""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO
from zlib import crc32

from mcap.opcode import Opcode
from rosbags.rosbag2.storage_mcap import McapReader

from semantic_slam.bag.chunk_limits import MAGIC_SIZE, RECORD_HEADER
from semantic_slam.bag.mcap_chunk import unpacked

FOOTER = struct.Struct("<BQQQI")  # opcode, length, start of the summary, start of its offsets, crc of both and of this
CHUNK_CRC = RECORD_HEADER.size + 24
"""Place of a chunk's checksum in its record."""
DATA_END_SIZE = RECORD_HEADER.size + 4
CRC_SIZE = 4
PIECE = 1 << 20


def summary_crc(path: Path) -> int:
    """Checksum of the summary of the mcap at ``path``, 0 for none. Raises ValueError where the summary differs."""
    with path.open("rb") as file:
        footer_start = file.seek(0, 2) - MAGIC_SIZE - FOOTER.size
        footer = _at(file, footer_start, FOOTER.size)
        opcode, _, summary_start, _, crc = FOOTER.unpack(footer)
        start = summary_start or footer_start
        if opcode != Opcode.FOOTER or crc == 0 or start > footer_start:  # not a checksum, or told by the reader
            return 0
        found, left = 0, footer_start - start
        file.seek(start)
        while piece := file.read(min(left, PIECE)):
            found, left = crc32(piece, found), left - len(piece)
    if crc32(footer[:-CRC_SIZE], found) != crc:
        raise ValueError(f"{path.name}: the summary at byte {start} does not fit its checksum")
    return int(crc)


def has_chunk_checksums(storage: McapReader) -> bool:
    """Whether all messages of an open mcap are in chunks with checksums."""
    with storage.path.open("rb") as file:
        places = [item.chunk_start_offset for item in storage.chunks] or _messages_or_chunks(file, storage.data_end)
        records = (_at(file, place, CHUNK_CRC + CRC_SIZE) for place in places)
        return all(record[0] == Opcode.CHUNK and any(record[CHUNK_CRC:]) for record in records)


def _messages_or_chunks(file: BinaryIO, end: int) -> Iterator[int]:
    """Places of the records of an mcap without index that are messages, or hold them."""
    place = MAGIC_SIZE
    while len(header := _at(file, place, RECORD_HEADER.size)) == RECORD_HEADER.size and place < end:
        opcode, length = RECORD_HEADER.unpack(header)
        if opcode in (Opcode.MESSAGE, Opcode.CHUNK):
            yield place
        place += RECORD_HEADER.size + length


def first_damage(storage: McapReader) -> str:
    """Place of the first damaged chunk of an open mcap; "" where all fit their checksums."""
    with storage.path.open("rb") as file:
        for item in sorted(storage.chunks, key=lambda item: item.chunk_start_offset):
            record = _at(file, item.chunk_start_offset, item.chunk_length)
            if damage := unpacked(record[RECORD_HEADER.size :], is_cut=False).damage:
                return f"{storage.path.name}: the chunk at byte {item.chunk_start_offset} {damage}"
    return ""


def _at(file: BinaryIO, place: int, size: int) -> bytes:
    file.seek(place)
    return file.read(size)
