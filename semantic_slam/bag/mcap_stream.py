"""The readable beginning of a damaged or unfinished mcap, read in the order of the file."""

import struct
import sys
from collections import Counter
from collections.abc import Collection, Iterator
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Message, Schema

from semantic_slam.bag.mcap_records import McapRecords, Record
from semantic_slam.bag.names import absolute


class RawMessage(NamedTuple):
    """One serialised message of a bag."""

    topic: str  # absolute name
    type_name: str
    stamp_ns: int  # log time
    cdr: bytes


class McapStream:
    """The readable beginning of a damaged mcap file."""

    def __init__(self, path: Path) -> None:
        """Read the file once, for its topics and its damage. Raises InputError when it is no mcap."""
        self.path = path
        self.topics: dict[str, str] = {}
        self.definitions: dict[str, str] = {}
        records = McapRecords(path)
        self.counts: Counter[str] = Counter()
        self.span_ns = (sys.maxsize, 0)
        for message in self._read_all(records):
            self.counts[message.topic] += 1
            self.span_ns = (min(self.span_ns[0], message.stamp_ns), max(self.span_ns[1], message.stamp_ns))
        self.damage = records.damage and f"{path.name}: {records.damage}"  # why and where reading ends; "" for nothing
        self.is_torn = records.is_torn  # the file ends in the midst of what was written last, as after a loss of power
        self.has_end = records.has_end  # its recorder closed it
        self.has_checksums = records.has_checksums

    def messages(self, topics: Collection[str] | None) -> Iterator[RawMessage]:
        """Every complete message before the damage, in file order; ``topics``: absolute names, None for all."""
        for message in self._read_all(McapRecords(self.path)):
            if topics is None or message.topic in topics:
                yield message

    def _read_all(self, records: McapRecords) -> Iterator[RawMessage]:
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        for record in records:
            try:
                message = self._read(record, schemas, channels)
            except (McapError, KeyError, struct.error, UnicodeDecodeError):
                records.damage = "a record of it cannot be read"
                return
            if message is not None:
                yield message

    def _read(self, record: Record, schemas: dict[int, Schema], channels: dict[int, Channel]) -> RawMessage | None:
        """Message of a record; None for a schema or channel record, which is stored."""
        stream = ReadDataStream(BytesIO(record.content))
        if record.opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            schemas[schema.id] = schema
            return None
        if record.opcode == Opcode.CHANNEL:
            channel = Channel.read(stream)
            channels[channel.id] = channel
            schema = schemas[channel.schema_id]
            self.topics[absolute(channel.topic)] = schema.name
            self.definitions[schema.name] = schema.data.decode("utf-8")
            return None
        message = Message.read(stream, len(record.content))
        topic = absolute(channels[message.channel_id].topic)
        return RawMessage(topic, self.topics[topic], message.log_time, message.data)
