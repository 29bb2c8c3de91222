"""Bags that ``import_dataset`` reads and writes."""

from pathlib import Path
from typing import Any

from semantic_slam.bag.reader import BagReader
from semantic_slam.bag.writer import BagWriter
from semantic_slam.cli import import_dataset
from semantic_slam.messages.codec import BY_TYPE_NAME, from_message


def run_import(monkeypatch: Any, *words: object) -> None:
    """``import_dataset`` with these words, in this process; its faults are raised."""
    monkeypatch.setattr("sys.argv", ["import_dataset", *map(str, words)])
    import_dataset.command()


def import_bag(monkeypatch: Any, *words: object) -> dict[str, list[Any]]:
    """Run the command with ``--out BAG`` as the last two of ``words``, and read the bag: topic -> our dataclasses."""
    run_import(monkeypatch, *words)
    return read_bag(Path(str(words[-1])))


def read_bag(path: Path) -> dict[str, list[Any]]:
    """Topic -> messages as dataclasses where they are ours, in the order of the bag."""
    values: dict[str, list[Any]] = {}
    with BagReader(path) as reader:
        for message in reader.messages():
            value = reader.decode(message.cdr, message.type_name)
            value = from_message(value) if message.type_name in BY_TYPE_NAME else value
            values.setdefault(message.topic, []).append(value)
    return values


def messages_of(path: Path, topic: str) -> list[Any]:
    """Our dataclasses of one topic, in the order of the bag."""
    with BagReader(path) as reader:
        return [from_message(reader.decode(item.cdr, item.type_name)) for item in reader.messages([topic])]


def merge_bags(out: Path, *parts: Path) -> None:
    """One bag of several, with the definitions of all."""
    with BagWriter(out) as writer:
        for part in parts:
            with BagReader(part) as reader:
                for message in reader.messages():
                    definition = reader.definitions[message.type_name]
                    writer.write_raw(message.topic, message.type_name, message.cdr, message.stamp_ns, definition)
