"""Comparison of a bag's metadata.yaml with its storage files: no message comes twice or is left out without a word."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from rosbags.rosbag2.reader import DirectoryReader

from semantic_slam.bag.names import absolute
from semantic_slam.errors import InputError

METADATA = "metadata.yaml"
REINDEX = "write it anew with ros2 bag reindex"
MOST_NAMED = 3
UNREADABLE = (OSError, ValueError, yaml.YAMLError, KeyError, TypeError)
"""What reading a metadata.yaml raises that is none."""


@dataclass(frozen=True)
class Contents:
    """Numbers of messages and type names by absolute topic name."""

    total: int
    counts: Counter[str]
    types: dict[str, str]


def contents_told(folder: DirectoryReader) -> Contents:
    """What metadata.yaml tells of an open bag. Raises ValueError where a number is none."""
    counts: Counter[str] = Counter()
    for item in folder.connections:
        counts[absolute(item.topic)] += int(item.msgcount)
    types = {absolute(item.topic): item.msgtype for item in folder.connections}
    return Contents(int(folder.metadata.message_count), counts, types)


def check_files(folder: Path, told: Iterable[str], found: Iterable[str]) -> None:
    """Raise InputError where file names ``told`` by metadata.yaml repeat, or lack one that was ``found``."""
    times = Counter(told)
    if twice := sorted(name for name, count in times.items() if count > 1):
        raise InputError(f"{folder}: {METADATA} names {twice[0]} {times[twice[0]]} times; {REINDEX}")
    if missed := sorted(name for name in found if not {name, Path(name).stem} & set(times)):
        raise InputError(f"{folder}: {METADATA} does not name {missed[0]}; {REINDEX}, or move that file away")


def missing_files(folder: Path, found: Iterable[str]) -> list[str]:
    """Names of storage files told by metadata.yaml that are not among those ``found``.

    None where it cannot be read, or where it does not tell all that were found: then files were renamed.
    """
    names, there = files_told(folder), set(found)
    return (
        [name for name in names if Path(name).name not in there] if there <= {Path(name).name for name in names} else []
    )


def files_told(folder: Path) -> list[str]:
    """Names of storage files in the order of metadata.yaml; none where it cannot be read."""
    try:
        return [str(name) for name in _information(folder)["relative_file_paths"]]
    except UNREADABLE:
        return []


def counts_told(folder: Path) -> Counter[str]:
    """Numbers of messages that metadata.yaml tells by absolute topic name; none where it cannot be read."""
    counts: Counter[str] = Counter()
    try:
        for item in _information(folder)["topics_with_message_count"]:
            counts[absolute(str(item["topic_metadata"]["name"]))] += int(item["message_count"])
    except UNREADABLE:
        return Counter()
    return counts


def _information(folder: Path) -> Any:
    return yaml.safe_load((folder / METADATA).read_text(encoding="utf-8"))["rosbag2_bagfile_information"]


def differences(told: Contents, found: Contents) -> str:
    """What metadata.yaml tells otherwise than the storage, in one line; "" for nothing."""
    parts = [f"{told.total} messages in place of {found.total}"] if told.total != found.total else []
    for topic in sorted(told.counts | found.counts):
        if told.counts[topic] != found.counts[topic]:
            parts.append(f"{told.counts[topic]} on {topic} in place of {found.counts[topic]}")
    for topic, name in sorted(found.types.items()):
        if (other := told.types.get(topic, name)) != name:
            parts.append(f"{other} on {topic} in place of {name}")
    more = [f"and {len(parts) - MOST_NAMED} differences more"] if len(parts) > MOST_NAMED else []
    return ", ".join(parts[:MOST_NAMED] + more)
