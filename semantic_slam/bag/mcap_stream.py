"""Sequential reading of a damaged mcap up to the damage; needs no index, footer or complete last chunk.

A record is an opcode (1 byte), a length (8 bytes) and the content. A truncated chunk is decompressed as far as
possible.
"""

import struct
from collections import Counter
from collections.abc import Collection, Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Message, Schema

from semantic_slam.bag.chunk_limits import CHUNK_HEADER, LARGEST_CHUNK, RECORD_HEADER
from semantic_slam.bag.names import absolute
from semantic_slam.errors import InputError

MAGIC = b"\x89MCAP0\r\n"
PIECE = 1 << 16


class RawMessage(NamedTuple):
    """One serialised message of a bag."""

    topic: str  # absolute name
    type_name: str
    stamp_ns: int  # log time
    cdr: bytes


class McapStream:
    """The readable beginning of a damaged mcap file."""

    def __init__(self, path: Path) -> None:
        """Scan the file for its topics. Raises InputError when it is not an mcap."""
        self.path = path
        self.topics: dict[str, str] = {}
        self.definitions: dict[str, str] = {}
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise InputError(f"{path}: no mcap file; give a rosbag2 folder, a .mcap or a .db3")
        self.counts = Counter(message.topic for message in self.messages(None))

    def messages(self, topics: Collection[str] | None) -> Iterator[RawMessage]:
        """Every complete message before the damage, in file order; ``topics``: absolute names, None for all."""
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        with self.path.open("rb") as file:
            file.seek(len(MAGIC))
            for opcode, content in _flat_records(file, self.path.stat().st_size):
                try:
                    message = self._read(opcode, content, schemas, channels)
                except (McapError, KeyError, struct.error, UnicodeDecodeError):
                    return  # this record is the damage
                if message is not None and (topics is None or message.topic in topics):
                    yield message

    def _read(
        self, opcode: int, content: bytes, schemas: dict[int, Schema], channels: dict[int, Channel]
    ) -> RawMessage | None:
        """Message of a record; None for a schema or channel record, which is stored."""
        stream = ReadDataStream(BytesIO(content))
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            schemas[schema.id] = schema
            return None
        if opcode == Opcode.CHANNEL:
            channel = Channel.read(stream)
            channels[channel.id] = channel
            schema = schemas[channel.schema_id]
            self.topics[absolute(channel.topic)] = schema.name
            self.definitions[schema.name] = schema.data.decode("utf-8")
            return None
        message = Message.read(stream, len(content))
        topic = absolute(channels[message.channel_id].topic)
        return RawMessage(topic, self.topics[topic], message.log_time, message.data)


def breaks_off_cleanly(path: Path) -> bool:
    """Whether an mcap only lacks its end, as after a killed recorder, with every existing record complete."""
    with path.open("rb") as file:
        file.seek(len(MAGIC))
        while len(header := file.read(RECORD_HEADER.size)) == RECORD_HEADER.size:
            opcode, length = RECORD_HEADER.unpack(header)
            content = file.read(min(length, path.stat().st_size))
            if opcode == Opcode.DATA_END or len(content) < length:
                return False
            if opcode == Opcode.CHUNK and not _is_whole(content):
                return False
        return header == b""


def _unzipped(data: bytes, most: int) -> bytes:
    """Decompressed zstd data up to their end or damage, at most ``most`` bytes."""
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


def _is_whole(chunk: bytes) -> bool:
    """Whether a chunk decompresses to as many bytes as it claims."""
    if len(chunk) < CHUNK_HEADER.size:
        return False
    _, _, size, _, _ = CHUNK_HEADER.unpack_from(chunk)
    return bool(len(_decompressed(chunk)) == size)


def _flat_records(file: BinaryIO, size: int) -> Iterator[tuple[int, bytes]]:
    """Complete schema, channel and message records, including those inside chunks."""
    for opcode, content, whole in _records(file, size):
        if opcode == Opcode.CHUNK:
            inner = _decompressed(content)
            yield from (
                (code, text)
                for code, text, complete in _records(BytesIO(inner), len(inner))
                if complete and _wanted(code)
            )
        elif whole and _wanted(opcode):
            yield opcode, content


def _wanted(opcode: int) -> bool:
    return opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)


def _records(file: BinaryIO, size: int) -> Iterator[tuple[int, bytes, bool]]:
    """Opcode, content and completeness of records; ends at the end of data or at a truncated record header."""
    while len(header := file.read(RECORD_HEADER.size)) == RECORD_HEADER.size:
        opcode, length = RECORD_HEADER.unpack(header)
        if opcode == Opcode.DATA_END:
            return
        content = file.read(min(length, size))
        yield opcode, content, len(content) == length


def _decompressed(chunk: bytes) -> bytes:
    """Decompressed records of a chunk; of a truncated chunk as many as possible."""
    if len(chunk) < CHUNK_HEADER.size:
        return b""
    name_end = CHUNK_HEADER.size + CHUNK_HEADER.unpack_from(chunk)[-1]
    compression = chunk[CHUNK_HEADER.size : name_end].decode("ascii", "replace")
    data = chunk[name_end + 8 :]  # after the length of the compressed data
    most = min(CHUNK_HEADER.unpack_from(chunk)[2], LARGEST_CHUNK)
    try:
        if compression == "zstd":
            return _unzipped(data, most)
        if compression == "lz4":
            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=most))
    except (zstandard.ZstdError, RuntimeError):
        return b""
    return data if compression == "" else b""
