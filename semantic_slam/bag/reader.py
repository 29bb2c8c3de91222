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
from rosbags.rosbag2.reader import DirectoryReader
from rosbags.serde import SerdeError
from rosbags.typesys.store import Typestore

from semantic_slam.bag.checksums import summary_crc
from semantic_slam.bag.chunk_limits import check_chunks
from semantic_slam.bag.definitions import extended_typestore, is_ours, older_typestore
from semantic_slam.bag.indexed_source import IndexedSource
from semantic_slam.bag.installed_definitions import register_installed
from semantic_slam.bag.mcap_stream import McapStream, RawMessage
from semantic_slam.bag.metadata_check import (
    METADATA,
    REINDEX,
    Contents,
    check_files,
    contents_told,
    counts_told,
    differences,
    files_told,
    missing_files,
)
from semantic_slam.bag.names import absolute
from semantic_slam.bag.older_messages import current_bytes
from semantic_slam.bag.storage import parts_of_one, storage_files
from semantic_slam.errors import InputError, one_line, shortened
from semantic_slam.messages.typestore import typestore

REMEDY = "give a rosbag2 folder, a .mcap or a .db3"
ROS_1 = ".bag"
IN_A_MISSING_FILE = "in a file that is missing"
"""Reason of messages that were recorded and cannot be read."""
_announced: set[str] = set()
"""Notices about bags already printed by this process, which may open a bag many times."""


class TruncatedBagError(InputError):
    """Raised at the damage of a bag, after every message before it has been returned."""


class Source(Protocol):
    """Interface of one readable part of a bag."""

    topics: dict[str, str]
    definitions: dict[str, str]
    counts: Counter[str]
    span_ns: tuple[int, int]  # least and greatest log time; of no message, the first is greater than the second
    has_checksums: bool

    def messages(self, topics: Collection[str] | None) -> Iterator[RawMessage]: ...


class BagReader:
    """Context manager that reads one bag. Topic names are absolute (``/odom``), however the bag spells them."""

    def __init__(self, path: Path, *, announces: bool = True) -> None:
        """Raise InputError when ``path`` does not exist. ``announces``: notices about the bag are printed."""
        self.path = Path(path)
        self._announces = announces
        if not self.path.exists():
            raise InputError(f"{self.path}: no such bag; {REMEDY}")
        if self.path.suffix == ROS_1 and self.path.is_file():
            convert = f"rosbags-convert --src {self.path} --dst {self.path.with_suffix('')}"
            raise InputError(f"{self.path}: a bag of ROS 1; convert it with {convert}, and give that folder")
        self.damage = ""  # why the bag cannot be read completely
        self.unfinished = ""  # set when the recorder was killed but all written data can be read
        self._stack = ExitStack()
        self._sources: list[Source] = []
        self._names: list[str] = []  # of the storage files of the sources, where these were opened one by one
        self._empty_topics: dict[str, str] = {}  # without messages, named by metadata.yaml alone
        self._is_storage_whole = False  # the damage is that of metadata.yaml
        self._older: dict[str, Typestore | None] = {}  # by type name; None: recorded with our definition

    def __enter__(self) -> Self:
        """Open the bag. Raises InputError when nothing can be read, or it would take too much memory.

        Raises it, too, when ``metadata.yaml`` names a storage file twice, or not at all, and when there is none in a
        folder of several recordings.
        """
        files = storage_files(self.path)
        if len(files) > 1 and not (self.path / METADATA).exists():
            self._announce(parts_of_one(self.path, files))
        for path in files:
            if path.suffix == ".mcap":
                check_chunks(path)
        with ExitStack() as opened:
            try:
                self._sources = self._indexed(self.path, opened)
            except InputError:
                raise
            except Exception as fault:  # the readers' exceptions have no common base class
                self._open_parts(_reason(fault), opened)
            self._stack = opened.pop_all()
        if not all(source.has_checksums for source in self._sources):
            self._announce(
                f"{self.path}: was written without checksums, so damage in it can pass unnoticed; what this version"
                " writes has them, and so has a copy by semantic_slam import bag"
            )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    @property
    def topics(self) -> dict[str, str]:
        """Type name by absolute topic name."""
        return self._empty_topics | {topic: name for source in self._sources for topic, name in source.topics.items()}

    @property
    def counts(self) -> Counter[str]:
        """Number of messages that can be read, by absolute topic name."""
        return sum((source.counts for source in self._sources), Counter())

    @property
    def num_messages(self) -> int:
        """Messages that can be read, of all topics."""
        return self.counts.total()

    @property
    def missing(self) -> Counter[str]:
        """Number of messages in storage files that are missing, as metadata.yaml tells, by absolute topic name."""
        is_part_missing = self._is_storage_whole and bool(self._missing_files())
        return counts_told(self.path) - self.counts if is_part_missing else Counter()

    @property
    def missing_by_ns(self) -> int | None:
        """Least log time of the storage files behind one that is missing; None: there is none behind."""
        missing = self._missing_files() if self._is_storage_whole else []
        if not missing:
            return None
        names = [Path(name).name for name in files_told(self.path)]
        behind = names[names.index(Path(missing[0]).name) :]
        starts = [source.span_ns[0] for name, source in zip(self._names, self._sources, strict=True) if name in behind]
        return min(starts, default=None)

    @property
    def missing_notice(self) -> str:
        """Which storage files are missing, in one line with the remedy; "" for none."""
        missing = self._missing_files() if self._is_storage_whole else []
        if not missing:
            return ""
        return f"{self.path}: {shortened(missing)} missing, of the files in {METADATA}; put what is missing beside them"

    @property
    def duration_s(self) -> float:
        """Seconds from the least log time of the messages that can be read to the greatest; 0 if there are none."""
        start_ns = min((source.span_ns[0] for source in self._sources), default=0)
        end_ns = max((source.span_ns[1] for source in self._sources), default=0)
        return max(end_ns - start_ns, 0) * 1e-9

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

    def _indexed(self, path: Path, opened: ExitStack) -> list[Source]:
        """The storage files of a whole bag, in the order of its recorder, or a single storage file."""
        for item in storage_files(path):
            if item.suffix == ".mcap":
                summary_crc(item)  # before anything is made of it
        reader = opened.enter_context(Reader(path)).storage
        if not isinstance(reader, DirectoryReader):
            return [IndexedSource(reader)]
        check_files(path, (item.path.name for item in reader.storages), (item.name for item in storage_files(path)))
        is_zipped = reader.metadata.compression_mode == "message"
        sources: list[Source] = [IndexedSource(item, is_zipped=is_zipped) for item in reader.storages]
        self._compare(contents_told(reader), _contents(sources))
        return sources

    def _compare(self, told: Contents, found: Contents) -> None:
        """Announce what metadata.yaml tells otherwise than the storage files."""
        self._empty_topics = {topic: name for topic, name in told.types.items() if not told.counts[topic]}
        if found_otherwise := differences(told, found):
            self._announce(f"{self.path}: {METADATA} tells {found_otherwise}; the storage is used; {REINDEX}")

    def _open_parts(self, reason: str, opened: ExitStack) -> None:
        """Open the storage files one by one: damaged mcaps up to the damage, unfinished ones to their end."""
        if _compression(self.path):
            raise InputError(f"{self.path}: a compressed bag that cannot be read ({reason}); record it again")
        was_closed = self.path.is_dir() and (self.path / METADATA).exists()
        damage, is_unfinished = "", False
        for path in storage_files(self.path):
            try:
                self._sources += self._indexed(path, opened)
                self._names.append(path.name)
            except Exception as fault:
                if path.suffix != ".mcap":
                    damage = _reason(fault)
                    continue
                stream = McapStream(path)
                self._sources.append(stream)
                self._names.append(path.name)
                if stream.damage or stream.has_end or was_closed:
                    damage = stream.damage or _reason(fault)
                else:
                    is_unfinished = True
        if not self._sources:
            raise InputError(f"{self.path}: not a readable bag ({reason}); {REMEDY}")
        self._is_storage_whole = was_closed and not damage
        self.damage = damage or (reason if was_closed else "")
        if is_unfinished:
            self._note_unfinished()

    def _note_unfinished(self) -> None:
        self.unfinished = (
            f"{self.path}: its recorder was killed before it closed the bag; the {self.num_messages} messages that it"
            " had written are used; end a recorder with Ctrl-C (SIGINT) to lose none"
        )
        self._announce(self.unfinished)

    def _announce(self, notice: str) -> None:
        if self._announces and notice not in _announced:
            _announced.add(notice)
            print(notice, file=sys.stderr)

    def _missing_files(self) -> list[str]:
        return missing_files(self.path, (item.name for item in storage_files(self.path)))

    def _truncated(self, reason: str, given: int) -> TruncatedBagError:
        if self._is_storage_whole and (missing := self._missing_files()):
            return TruncatedBagError(
                f"{self.path}: {shortened(missing)} missing, of the files in {METADATA}; the {given} messages of the"
                " others were used; put what is missing beside them"
            )
        if self._is_storage_whole:
            return TruncatedBagError(
                f"{self.path}: {METADATA} cannot be used ({reason}); the {given} messages of its storage were used;"
                f" {REINDEX}"
            )
        return TruncatedBagError(
            f"{self.path}: the bag is damaged ({reason}); the {given} messages before the damage were used;"
            " record it again for the rest"
        )


def _contents(sources: Collection[Source]) -> Contents:
    counts = sum((source.counts for source in sources), Counter[str]())
    types = {topic: name for source in sources for topic, name in source.topics.items()}
    return Contents(counts.total(), counts, types)


def _compression(folder: Path) -> str:
    """rosbag2 compression mode of a bag folder; "" when none (or only inside the storage)."""
    try:
        information = yaml.safe_load((folder / METADATA).read_text(encoding="utf-8"))
        mode = str(information["rosbag2_bagfile_information"].get("compression_mode", "")).lower()
    except (OSError, ValueError, yaml.YAMLError, KeyError, TypeError, AttributeError):
        return ""
    return "" if mode == "none" else mode


def _reason(fault: BaseException) -> str:
    return one_line(fault, 200).rstrip(".") or type(fault).__name__
