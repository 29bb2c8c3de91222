"""A bag copied message by message, some of them changed on the way: recordings with a mistake in them."""

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from semantic_slam.bag.reader import BagReader
from semantic_slam.bag.writer import BagWriter
from semantic_slam.messages.standard import NANOSECONDS, stamp_ns, time_message

Change = Callable[[Any], Any]
"""The message in place of one; None: it is left out."""


def spoiled(bag: Path, copy: Path, changes: Mapping[str, Change]) -> Path:
    """A copy of a bag with the messages of some topics (absolute names) changed; the map prior lies beside it, too."""
    with BagReader(bag) as reader, BagWriter(copy) as writer:
        for message in reader.messages():
            if message.topic not in changes:
                writer.write_raw(message.topic, message.type_name, message.cdr, message.stamp_ns)
                continue
            changed = changes[message.topic](reader.decode(message.cdr, message.type_name))
            if changed is not None:
                writer.write(message.topic, changed, message.stamp_ns)
    if (bag / "objects.json").exists():
        shutil.copy(bag / "objects.json", copy)
    return copy


def later(seconds: float) -> Change:
    """Messages whose stamps are so much later."""

    def change(message: Any) -> Any:
        message.header.stamp = time_message(stamp_ns(message.header.stamp) + round(seconds * NANOSECONDS))
        return message

    return change
