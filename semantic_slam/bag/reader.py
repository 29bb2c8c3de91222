"""Reading of bags: rosbag2 folders and single storage files, mcap or sqlite3, compressed, damaged or intact."""

import hashlib
import sys
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import ExitStack
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self

import yaml
from rosbags.rosbag2 import Reader
from rosbags.serde import SerdeError
from rosbags.typesys.store import Typestore

from semantic_slam.bag.chunk_limits import check_chunks
from semantic_slam.bag.definitions import extended_typestore, is_ours, older_typestore
from semantic_slam.bag.installed_definitions import register_installed
from semantic_slam.bag.mcap_stream import McapStream, RawMessage, breaks_off_cleanly
from semantic_slam.bag.names import absolute
from semantic_slam.bag.older_messages import current_bytes
from semantic_slam.errors import InputError, one_line
from semantic_slam.messages.typestore import typestore

REMEDY = "give a rosbag2 folder, a .mcap or a .db3"
_announced: set[str] = set()
"""Notices about unfinished bags already printed by this process, which may open a bag many times."""


class TruncatedBagError(InputError):
    """Raised at the damage of a bag, after every message before it has been returned."""


class Source(Protocol):
    """Interface of one readable part of a bag."""

    topics: dict[str, str]
    definitions: dict[str, str]
    counts: Counter[str]

    def messages(self, topics: Collection[str] | None) -> Iterator[RawMessage]: ...


class IndexedSource:
    """An intact folder or storage file, read through its index in log-time order."""

    def __init__(self, reader: Reader) -> None:
        """``reader`` must be open."""
        self._reader = reader
        self.counts: Counter[str] = Counter()
        for item in reader.connections:
            self.counts[absolute(item.topic)] += item.msgcount
        self.topics = {absolute(item.topic): item.msgtype for item in reader.connections}
        self.definitions = {item.msgtype: item.msgdef.data for item in reader.connections if item.msgdef.data}

    def messages(self, topics: Collection[str] | None) -> Iterator[RawMessage]:
        wanted = [item for item in self._reader.connections if topics is None or absolute(item.topic) in topics]
        if wanted:
            for connection, stamp_ns, data in self._reader.messages(wanted):
                yield RawMessage(absolute(connection.topic), connection.msgtype, stamp_ns, bytes(data))


class BagReader:
    """Context manager that reads one bag. Topic names are absolute (``/odom``), however the bag spells them."""

    def __init__(self, path: Path, *, announces: bool = True) -> None:
        """Raise InputError when ``path`` does not exist. ``announces``: a notice is printed about an unfinished bag."""
        self.path = Path(path)
        self._announces = announces
        if not self.path.exists():
            raise InputError(f"{self.path}: no such bag; {REMEDY}")
        self.damage = ""  # why the bag cannot be read completely
        self.unfinished = ""  # set when the recorder was killed but all written data can be read
        self._stack = ExitStack()
        self._sources: list[Source] = []
        self._older: dict[str, Typestore | None] = {}  # by type name; None: recorded with our definition

    def __enter__(self) -> Self:
        """Open the bag. Raises InputError when nothing can be read, or when it would take too much memory."""
        for path in storage_files(self.path):
            if path.suffix == ".mcap":
                check_chunks(path)
        try:
            self._sources = [self._indexed(self.path)]
        except Exception as fault:  # the readers' exceptions have no common base class
            self._open_parts(_reason(fault))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    @property
    def topics(self) -> dict[str, str]:
        """Type name by absolute topic name."""
        return {topic: kind for source in self._sources for topic, kind in source.topics.items()}

    @property
    def counts(self) -> Counter[str]:
        """Number of messages that can be read, by absolute topic name."""
        return sum((source.counts for source in self._sources), Counter())

    @property
    def num_messages(self) -> int:
        """Messages that can be read, of all topics."""
        return self.counts.total()

    @property
    def definitions(self) -> dict[str, str]:
        """Embedded definition texts by type name."""
        return {name: text for source in self._sources for name, text in source.definitions.items()}

    def messages(self, topics: Collection[str] | None = None) -> Iterator[RawMessage]:
        """Messages of these topics (relative or absolute names), or all; raises TruncatedBagError at the damage.

        Messages of our own types recorded by an older version are converted to the current definition.
        """
        names = None if topics is None else {absolute(topic) for topic in topics}
        given = 0
        for source in self._sources:
            iterator = source.messages(names)
            while True:
                try:
                    message = next(iterator, None)
                except Exception as fault:  # damage not visible in the index
                    raise self._truncated(_reason(fault), given) from None
                if message is None:
                    break
                given += 1
                yield self._by_our_definition(message)
        if self.damage:
            raise self._truncated(self.damage, given)

    def check_definitions(self) -> None:
        """Raise InputError when one of our types was recorded with a definition that this version cannot read."""
        _ = self._store

    def decode(self, cdr: bytes, type_name: str) -> Any:
        """Decode bytes from :meth:`messages` by our definition, the bag's or an installed one. Raises InputError."""
        self.check_definitions()
        store = typestore() if type_name in typestore().types else self._store  # its decoders are compiled already
        if type_name not in store.types and not register_installed(store, type_name):
            package = type_name.partition("/")[0]
            raise InputError(
                f"{self.path}: type {type_name} is neither embedded in the bag nor installed; source a workspace that"
                f" has {package}, or convert the bag to mcap with ros2 bag convert where {package} is installed"
            )
        try:
            return store.deserialize_cdr(cdr, type_name)
        except Exception as fault:  # any decoder error means that the bytes are invalid
            raise InputError(
                f"{self.path}: a message of type {type_name} does not decode ({_reason(fault)}); record the bag again"
            ) from None

    def sha256(self) -> str:
        """SHA-256 hex digest over the concatenated storage files."""
        digest = hashlib.sha256()
        for path in storage_files(self.path):
            with path.open("rb") as file:
                while block := file.read(1 << 20):
                    digest.update(block)
        return digest.hexdigest()

    def _by_our_definition(self, message: RawMessage) -> RawMessage:
        """The message, converted where it was recorded with an older definition. Raises InputError where that fails."""
        older = self._older_typestore(message.type_name) if is_ours(message.type_name) else None
        if older is None:
            return message
        try:
            return message._replace(cdr=current_bytes(message.cdr, message.type_name, older))
        except SerdeError:
            return message  # invalid bytes are reported when they are decoded

    def _older_typestore(self, type_name: str) -> Typestore | None:
        if type_name not in self._older:
            text = self.definitions.get(type_name, "")
            self._older[type_name] = older_typestore(type_name, text) if text else None
        return self._older[type_name]

    @cached_property
    def _store(self) -> Typestore:
        return extended_typestore(self.definitions)

    def _indexed(self, path: Path) -> IndexedSource:
        return IndexedSource(self._stack.enter_context(Reader(path)))

    def _open_parts(self, reason: str) -> None:
        """Open the storage files one by one: damaged mcaps up to the damage, unfinished ones to their end."""
        if _compression(self.path):
            raise InputError(f"{self.path}: a compressed bag that cannot be read ({reason}); record it again")
        was_closed = self.path.is_dir() and (self.path / "metadata.yaml").exists()
        if was_closed:
            self.damage = reason
        is_unfinished = False
        for path in storage_files(self.path):
            try:
                self._sources.append(self._indexed(path))
            except Exception as fault:
                if path.suffix == ".mcap":
                    self._sources.append(McapStream(path))
                if path.suffix == ".mcap" and not was_closed and breaks_off_cleanly(path):
                    is_unfinished = True
                else:
                    self.damage = _reason(fault)
        if not self._sources:
            raise InputError(f"{self.path}: not a readable bag ({reason}); {REMEDY}")
        if is_unfinished:
            self._announce_unfinished()

    def _announce_unfinished(self) -> None:
        self.unfinished = (
            f"{self.path}: its recorder was killed before it closed the bag; the {self.num_messages} messages that it"
            " had written are used; end a recorder with Ctrl-C (SIGINT) to lose none"
        )
        if self._announces and self.unfinished not in _announced:
            _announced.add(self.unfinished)
            print(self.unfinished, file=sys.stderr)

    def _truncated(self, reason: str, given: int) -> TruncatedBagError:
        return TruncatedBagError(
            f"{self.path}: the bag is damaged ({reason}); the {given} messages before the damage were used;"
            " record it again for the rest"
        )


def storage_files(path: Path) -> list[Path]:
    """The storage files of a bag in the order of their names."""
    if path.is_file():
        return [path]
    return sorted(item for item in path.iterdir() if {".mcap", ".db3"} & set(item.suffixes) and item.is_file())


def _compression(folder: Path) -> str:
    """rosbag2 compression mode of a bag folder; "" when none (or only inside the storage)."""
    try:
        information = yaml.safe_load((folder / "metadata.yaml").read_text(encoding="utf-8"))
        mode = str(information["rosbag2_bagfile_information"].get("compression_mode", "")).lower()
    except (OSError, ValueError, yaml.YAMLError, KeyError, TypeError, AttributeError):
        return ""
    return "" if mode == "none" else mode


def _reason(fault: BaseException) -> str:
    return one_line(fault, 200).rstrip(".") or type(fault).__name__
