"""Continuation of a bag whose recorder was killed: its complete messages are copied to the start of the new bag."""

import os
import shutil
from collections.abc import Iterator
from itertools import count
from pathlib import Path

from semantic_slam.bag.mcap_stream import McapStream, RawMessage
from semantic_slam.bag.metadata_check import METADATA
from semantic_slam.bag.storage import storage_files
from semantic_slam.errors import InputError
from semantic_slam.outputs import staged_places


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
        self._damaged: dict[Path, str] = {}  # by folder, found by the last pass over the messages

    def messages(self) -> Iterator[tuple[RawMessage, str]]:
        """Every complete message with its type definition, once: without the copies that a second kill broke off."""
        parts = list(self._folders)
        for folder in self._folders:
            if any(self._is_in(folder, other) for other in parts if other != folder):
                parts.remove(folder)
        for folder in parts:
            yield from self._messages_of(folder)

    def _is_in(self, part: Path, whole: Path) -> bool:
        """Whether the messages of ``part`` are also in ``whole``, in the same order, as where one was copied."""
        others = (message for message, _ in self._messages_of(whole))
        return all(message in others for message, _ in self._messages_of(part))  # ``in`` goes on where it found one

    def _messages_of(self, folder: Path) -> Iterator[tuple[RawMessage, str]]:
        for path in storage_files(folder):
            try:
                stream = McapStream(path)
            except InputError as fault:
                if path.stat().st_size:  # else killed before the first byte was written
                    self._damaged[folder] = str(fault)
                continue
            if stream.damage and not stream.is_torn:
                self._damaged[folder] = stream.damage
            for message in stream.messages(None):
                yield message, stream.definitions[message.type_name]

    def done(self, bag: Path) -> list[str]:
        """Delete the old parts, whose messages are in the new bag.

        Damaged parts are moved beside ``bag`` instead: what follows the damage is in no other. Returns a line for each.
        """
        lines = []
        for folder in self._folders:
            if folder in self._damaged:
                kept = _free(bag)
                shutil.move(folder, kept)
                lines.append(
                    f"{kept}: damaged ({self._damaged[folder]}); the bag goes on with what is before the damage"
                )
            else:
                shutil.rmtree(folder)
        return lines


def _free(bag: Path) -> Path:
    """A new name beside ``bag`` for a damaged part of it."""
    return next(path for n in count() if not (path := bag.with_name(f"{bag.name}.damaged_{n:03}")).exists())


def _prefix(place: Path) -> str:
    return f".{place.name}.killed_"


def _earlier(place: Path) -> list[Path]:
    return sorted(place.parent.glob(f"{_prefix(place)}*"))
