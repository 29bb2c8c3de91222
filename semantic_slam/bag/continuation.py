"""A bag whose recorder was killed is gone on with: its messages, as far as they are whole, begin the new one."""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from semantic_slam.bag.mcap_stream import McapStream, RawMessage
from semantic_slam.bag.reader import storage_files
from semantic_slam.errors import InputError
from semantic_slam.outputs import staged_places

METADATA = "metadata.yaml"


def unfinished_bag(path: Path) -> Path | None:
    """Where a killed recorder of ``path`` left its bag: there, or beside an old one; None where none did."""
    for place in (path, *staged_places(path)):
        if (place.is_dir() and not (place / METADATA).exists()) or _earlier(place):
            return place
    return None


class Continuation:
    """What earlier recorders left of the bag at ``place``; it is moved out of the way, and kept until :meth:`done`."""

    def __init__(self, place: Path) -> None:
        if place.exists():
            os.replace(place, place.with_name(f"{_prefix(place)}{len(_earlier(place)):03}"))
        self._folders = _earlier(place)

    def messages(self) -> Iterator[tuple[RawMessage, str]]:
        """Each whole message with its type's definition; what was taken over before a second death comes twice."""
        for folder in self._folders:
            for path in storage_files(folder):
                try:
                    stream = McapStream(path)
                except InputError:  # killed before its first byte
                    continue
                for message in stream.messages(None):
                    yield message, stream.definitions[message.type_name]

    def done(self) -> None:
        """Everything is in the new bag."""
        for folder in self._folders:
            shutil.rmtree(folder)


def _prefix(place: Path) -> str:
    return f".{place.name}.killed_"


def _earlier(place: Path) -> list[Path]:
    return sorted(place.parent.glob(f"{_prefix(place)}*"))
