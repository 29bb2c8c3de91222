"""Checks of the sizes claimed by mcap chunks, before decompression: 40 kB may claim gigabytes."""

import struct
from contextlib import suppress
from pathlib import Path

import zstandard
from mcap.opcode import Opcode

from semantic_slam.errors import InputError

MAGIC_SIZE = 8
RECORD_HEADER = struct.Struct("<BQ")
CHUNK_HEADER = struct.Struct("<QQQII")  # start, end, uncompressed size, crc, length of the compression's name
LARGEST_CHUNK = 256 << 20
"""Largest chunk in bytes; recorders close a chunk at a few megabytes, or after one larger message."""
FRAME_HEADER = 18
"""Bytes of a zstd frame header, which contains the content size."""


def check_chunks(path: Path) -> None:
    """Raise InputError where a chunk of the mcap at ``path`` claims more than any recorder writes."""
    size = path.stat().st_size
    with path.open("rb") as file:
        file.seek(MAGIC_SIZE)
        while len(header := file.read(RECORD_HEADER.size)) == RECORD_HEADER.size:
            opcode, length = RECORD_HEADER.unpack(header)
            following = file.tell() + length
            if opcode == Opcode.CHUNK and _claimed(file.read(min(length, 64))) > LARGEST_CHUNK:
                raise InputError(
                    f"{path}: a chunk claims more than {LARGEST_CHUNK >> 20} MiB, or is damaged; record it again, with"
                    " smaller chunks"
                )
            if opcode == Opcode.DATA_END or following > size:
                return
            file.seek(following)


def _claimed(begin: bytes) -> int:
    """Uncompressed size claimed by a chunk: the larger of its own header's and its zstd frame's value."""
    if len(begin) < CHUNK_HEADER.size:
        return 0
    _, _, told, _, name_length = CHUNK_HEADER.unpack_from(begin)
    data = begin[CHUNK_HEADER.size + name_length + 8 :][:FRAME_HEADER]
    with suppress(zstandard.ZstdError):  # not zstd, or unreadable
        told = max(told, zstandard.frame_content_size(data))
    return int(told)
