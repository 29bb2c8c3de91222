"""Content of one chunk of an mcap file, decompressed and checked against its sizes and its checksum."""

from typing import NamedTuple
from zlib import crc32

import lz4.frame  # type: ignore[import-untyped]
import zstandard

from semantic_slam.bag.chunk_limits import CHUNK_HEADER, LARGEST_CHUNK

PIECE = 1 << 16
LENGTH_SIZE = 8
CUT_OFF = "is cut off"


class Unpacked(NamedTuple):
    """Records of a chunk."""

    records: bytes  # of a damaged chunk with a checksum none, of another as many as there are before the damage
    damage: str  # what is wrong with the chunk; "" for nothing
    has_checksum: bool


def unpacked(content: bytes, *, is_cut: bool) -> Unpacked:
    """The records in the ``content`` of a chunk's record; ``is_cut``: the file ends in its midst."""
    if len(content) < CHUNK_HEADER.size:
        return Unpacked(b"", CUT_OFF, False)
    _, _, size, crc, name_length = CHUNK_HEADER.unpack_from(content)
    name_end = CHUNK_HEADER.size + name_length
    told = int.from_bytes(content[name_end : name_end + LENGTH_SIZE], "little")
    data = content[name_end + LENGTH_SIZE :]
    compression = content[CHUNK_HEADER.size : name_end].decode("ascii", "replace")
    records = _decompressed(compression, data[:told], min(size, LARGEST_CHUNK))
    if is_cut and len(data) < told:
        return Unpacked(records, CUT_OFF, crc != 0)
    if crc and (len(records) != size or crc32(records) != crc):
        return Unpacked(b"", "does not fit its checksum", True)
    if len(records) != size or len(data) != told:
        return Unpacked(records, "does not have the size that it states", crc != 0)
    return Unpacked(records, "", crc != 0)


def _decompressed(compression: str, data: bytes, most: int) -> bytes:
    """At most ``most`` decompressed bytes, up to the damage."""
    if compression == "zstd":
        return _unzipped(data, most)
    if compression == "lz4":
        try:
            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=most))
        except RuntimeError:
            return b""
    return data if compression == "" else b""


def _unzipped(data: bytes, most: int) -> bytes:
    pieces: list[bytes] = []
    with zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=False) as reader:
        left = most
        while left > 0:
            try:
                piece = reader.read(min(left, PIECE))
            except zstandard.ZstdError:
                break
            if not piece:
                break
            pieces.append(piece)
            left -= len(piece)
    return b"".join(pieces)
