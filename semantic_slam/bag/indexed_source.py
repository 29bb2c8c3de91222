"""Reading of an intact storage file of a bag through its index."""

from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Protocol

import zstandard
from rosbags.interfaces import Connection
from rosbags.rosbag2.metadata import ReaderMetadata
from rosbags.rosbag2.storage_mcap import McapReader

from semantic_slam.bag.checksums import first_damage, has_chunk_checksums, summary_crc
from semantic_slam.bag.chunk_limits import LARGEST_CHUNK
from semantic_slam.bag.mcap_stream import RawMessage
from semantic_slam.bag.names import absolute
from semantic_slam.errors import one_line


class Storage(Protocol):
    """An open reader of rosbags."""

    path: Path
    connections: list[Connection]
    metadata: ReaderMetadata

    def messages(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, int, bytes]]: ...


class IndexedSource:
    """One intact storage file, read through its index in log-time order."""

    def __init__(self, storage: Storage, *, is_zipped: bool = False) -> None:
        """``is_zipped``: each message is compressed by itself. Raises ValueError where the index is damaged."""
        self._storage = storage
        self._is_zipped = is_zipped
        self.has_checksums = isinstance(storage, McapReader) and _has_checksums(storage)
        if isinstance(storage, McapReader):
            _complete_index(storage)
        self.counts: Counter[str] = Counter()
        for item in storage.connections:
            self.counts[absolute(item.topic)] += item.msgcount
        self.topics = {absolute(item.topic): item.msgtype for item in storage.connections}
        self.span_ns = (storage.metadata.start_time, storage.metadata.end_time)
        self.definitions = {item.msgtype: item.msgdef.data for item in storage.connections if item.msgdef.data}

    def messages(self, topics: Collection[str] | None) -> Iterator[RawMessage]:
        """Messages of these absolute topic names, None for all. Raises ValueError at the damage."""
        wanted = [item for item in self._storage.connections if topics is None or absolute(item.topic) in topics]
        told, given = sum(item.msgcount for item in wanted), 0
        try:
            for connection, stamp_ns, data in self._storage.messages(wanted) if wanted else ():
                given += 1
                cdr = _unzipped(data) if self._is_zipped else bytes(data)
                yield RawMessage(absolute(connection.topic), connection.msgtype, stamp_ns, cdr)
        except Exception as fault:  # the readers' exceptions have no common base class
            raise ValueError(self._place() or one_line(fault) or type(fault).__name__) from fault
        if told and given != told:  # without statistics an index tells no numbers
            raise ValueError(f"{self._storage.path.name}: its index tells {told} messages in place of {given}")

    def _place(self) -> str:
        return first_damage(self._storage) if isinstance(self._storage, McapReader) else ""


def _has_checksums(storage: McapReader) -> bool:
    """Whether an open mcap has checksums of its summary and of all messages. Raises ValueError at a wrong one."""
    return summary_crc(storage.path) != 0 and has_chunk_checksums(storage)


def _complete_index(storage: McapReader) -> None:
    """Have chunks without an index of their messages (``noMessageIndex``) searched for those of every topic.

    Raises ValueError where the topics are not known without reading (``noStatistics`` and ``noRepeatedChannels``).
    """
    if storage.chunks and not storage.channels:
        raise ValueError(f"{storage.path.name}: its index names no topics")
    for chunk in storage.chunks:
        if not chunk.message_index_offsets:
            chunk.channel_count.update(dict.fromkeys(storage.channels, 1))


def _unzipped(data: bytes) -> bytes:
    """Decompressed message. Raises ZstdError, and ValueError where it would take too much memory."""
    if zstandard.frame_content_size(data) > LARGEST_CHUNK:
        raise ValueError(f"a message claims more than {LARGEST_CHUNK >> 20} MiB")
    return zstandard.ZstdDecompressor().decompress(data, max_output_size=LARGEST_CHUNK)
