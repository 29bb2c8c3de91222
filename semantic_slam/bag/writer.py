"""Writing of rosbag2 folders: mcap with zstd-compressed chunks, checksums and embedded type definitions."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin

from semantic_slam.bag.checksum_writer import ChecksumBagWriter, ChecksumWriter
from semantic_slam.bag.definitions import extended_typestore, register
from semantic_slam.bag.names import absolute
from semantic_slam.errors import InputError
from semantic_slam.messages.codec import CODECS, to_message
from semantic_slam.messages.topics import LATCHED
from semantic_slam.messages.typestore import serialize
from semantic_slam.outputs import WRITER, WRITER_KEY, check_is_bag

UNLIMITED = QosTime(9223372036, 854775807)
"""ROS 2's value for an unlimited deadline, lifespan or lease."""

LATCHED_QOS = Qos(
    QosHistory.KEEP_LAST,
    1,
    QosReliability.RELIABLE,
    QosDurability.TRANSIENT_LOCAL,
    UNLIMITED,
    UNLIMITED,
    QosLiveliness.AUTOMATIC,
    UNLIMITED,
    False,
)
_LATCHED = frozenset(absolute(topic) for topic in LATCHED)


class BagWriter:
    """Context manager that writes one bag folder; closed properly after an exception, too, keeping what was written.

    Topic names are made absolute, as by recorders: ``odom`` is stored as ``/odom``.
    """

    def __init__(self, path: Path) -> None:
        """Create the bag. Raises InputError where ``path`` exists or cannot be written; nothing is replaced."""
        self.path = Path(path)
        with _faults_of(self.path):
            _make_room(self.path)
        self._writer = ChecksumBagWriter(self.path, version=9, storage_plugin=StoragePlugin.MCAP)
        self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        self._writer.set_custom_data(WRITER_KEY, WRITER)
        self._store = extended_typestore({})
        self._connections: dict[str, Connection] = {}

    def __enter__(self) -> Self:
        with _faults_of(self.path):
            self._writer.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        with suppress(OSError) if fault is not None else _faults_of(self.path):
            self._writer.close()

    def write(self, topic: str, message: Any, stamp_ns: int) -> None:
        """Write a message, or one of our dataclasses that has a codec, at log time ``stamp_ns``."""
        if type(message) in CODECS:
            message = to_message(message)
        self.write_raw(topic, message.__msgtype__, serialize(message), stamp_ns)

    def write_raw(self, topic: str, type_name: str, cdr: bytes, stamp_ns: int, definition: str = "") -> None:
        """Write CDR bytes; an unknown type needs its ``definition``, followed by those of nested types."""
        name = absolute(topic)
        connection = self._connections.get(name)
        if connection is None:
            connection = self._connections[name] = self._connect(name, type_name, definition)
        elif connection.msgtype != type_name:
            raise ValueError(f"{name} holds {connection.msgtype}, not {type_name}")
        with _faults_of(self.path):
            self._writer.write(connection, int(stamp_ns), cdr)

    def flush(self) -> None:
        """Flush to the operating system, so that the data survive a kill of this process."""
        assert isinstance(self._writer.storage, ChecksumWriter)
        with _faults_of(self.path):
            self._writer.storage.flush()

    def _connect(self, name: str, type_name: str, definition: str) -> Connection:
        if type_name not in self._store.types:
            if not definition:
                raise InputError(f"{self.path}: topic {name} has the unknown type {type_name}; embed its definition")
            register(self._store, type_name, definition)
        return self._writer.add_connection(
            name,
            type_name,
            typestore=self._store,
            offered_qos_profiles=[LATCHED_QOS] if name in _LATCHED else [],
        )


@contextmanager
def _faults_of(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as fault:
        raise InputError(f"{path}: cannot be written ({fault.strerror}); name another output folder") from None


def _make_room(path: Path) -> None:
    """Remove an empty folder at ``path``. Raises InputError where anything else exists there."""
    check_is_bag(path)
    if path.exists():
        if any(path.iterdir()):
            raise InputError(f"{path}: exists already; name another output")
        path.rmdir()
