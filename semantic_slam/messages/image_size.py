"""Size claimed by a compressed image's header, checked before decoding: a few bytes may claim gigabytes."""

import struct

PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
PNG_SIZE = struct.Struct(">II")
PNG_SIZE_AT = 16
PNG_CHUNK = struct.Struct(">I4s")
"""PNG chunk header: length and name; the chunk data and a four-byte checksum follow."""
PNG_CHECKSUM_BYTES, PNG_END = 4, b"IEND"
JPEG_MAGIC = b"\xff\xd8"
JPEG_SEGMENT = struct.Struct(">BBH")
JPEG_SIZE = struct.Struct(">xHH")
JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""JPEG markers of the segments that contain the image size (SOF)."""
JPEG_ALONE = frozenset({0x01, 0xFF, *range(0xD0, 0xD9)})
"""JPEG markers without a segment."""


def claimed_size(data: bytes) -> tuple[int, int] | None:
    """(width, height) in the header of a PNG or JPEG; None where there is none, or PNG chunks are incomplete.

    A decoder would allocate memory for a chunk that claims gigabytes even where its data are missing.
    """
    if data.startswith(PNG_MAGIC):
        return _png_size(data)
    return _jpeg_size(data) if data.startswith(JPEG_MAGIC) else None


def is_known(data: bytes) -> bool:
    """Whether the data begin like a PNG or JPEG, the formats whose size can be read."""
    return data.startswith((PNG_MAGIC, JPEG_MAGIC))


def _png_size(data: bytes) -> tuple[int, int] | None:
    at = len(PNG_MAGIC)
    if len(data) < PNG_SIZE_AT + PNG_SIZE.size:
        return None
    while at + PNG_CHUNK.size <= len(data):
        length, name = PNG_CHUNK.unpack_from(data, at)
        at += PNG_CHUNK.size + length + PNG_CHECKSUM_BYTES
        if at > len(data):
            return None
        if name == PNG_END:
            break
    width, height = PNG_SIZE.unpack_from(data, PNG_SIZE_AT)
    return int(width), int(height)


def _jpeg_size(data: bytes) -> tuple[int, int] | None:
    at = len(JPEG_MAGIC)
    while at + JPEG_SEGMENT.size + JPEG_SIZE.size <= len(data):
        prefix, marker, length = JPEG_SEGMENT.unpack_from(data, at)
        if prefix != 0xFF:
            return None
        if marker in JPEG_ALONE:
            at += 1 if marker == 0xFF else 2
            continue
        if marker in JPEG_FRAMES:
            height, width = JPEG_SIZE.unpack_from(data, at + JPEG_SEGMENT.size)
            return int(width), int(height)
        at += 2 + length
    return None
