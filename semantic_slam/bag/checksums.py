"""Checksums of mcap files: CRC-32 of each chunk, of the summary with its index, and of the data before it.

A checksum of 0 says that none was written.
"""

import struct
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
    if not storage.chunks:
        return bool(storage.metadata.message_count == 0)
    with storage.path.open("rb") as file:
        return all(any(_at(file, item.chunk_start_offset + CHUNK_CRC, CRC_SIZE)) for item in storage.chunks)


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
