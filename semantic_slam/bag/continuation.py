"""Continuation of a bag whose recorder was killed: its complete messages are copied to the start of the new bag."""

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
    """Location of a killed recorder's unfinished bag: ``path`` or a staging place beside it; None: there is none."""
    for place in (path, *staged_places(path)):
        if (place.is_dir() and not (place / METADATA).exists()) or _earlier(place):
            return place
    return None


class Continuation:
    """Unfinished bags of earlier recorders at ``place``, moved aside and kept until :meth:`done`."""

    def __init__(self, place: Path) -> None:
        if place.exists():
            os.replace(place, place.with_name(f"{_prefix(place)}{len(_earlier(place)):03}"))
        self._folders = _earlier(place)

    def messages(self) -> Iterator[tuple[RawMessage, str]]:
        """Every complete message with its type definition; messages copied before a second kill come twice."""
        for folder in self._folders:
            for path in storage_files(folder):
                try:
                    stream = McapStream(path)
                except InputError:  # killed before the first byte was written
                    continue
                for message in stream.messages(None):
                    yield message, stream.definitions[message.type_name]

    def done(self) -> None:
        """Delete the old parts: everything is in the new bag."""
        for folder in self._folders:
            shutil.rmtree(folder)


def _prefix(place: Path) -> str:
    return f".{place.name}.killed_"


def _earlier(place: Path) -> list[Path]:
    return sorted(place.parent.glob(f"{_prefix(place)}*"))
