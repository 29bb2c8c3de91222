"""The storage files of a bag, and whether those of a folder without metadata.yaml are of one recording."""

import re
import string
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from semantic_slam.bag.metadata_check import METADATA
from semantic_slam.errors import InputError, shortened

STORAGE = re.compile(r"[^.].*\.(mcap|db3)(\.zstd)?")
"""Names of storage files: not hidden ones, which other systems leave beside copies, nor backups."""


def storage_files(path: Path) -> list[Path]:
    """The storage files of a bag in the order in which its recorder wrote them, ``NAME_2.mcap`` before ``NAME_10``."""
    if path.is_file():
        return [path]
    return sorted((item for item in path.iterdir() if STORAGE.fullmatch(item.name) and item.is_file()), key=_split)


def _split(path: Path) -> tuple[str, int, str]:
    """Sort key: name of the recording, number of its storage file (-1 without one), and the whole name for ties."""
    stem = _stem(path)
    recording = stem.rstrip(string.digits)
    number = stem[len(recording) :]
    return recording, int(number) if number else -1, path.name


def _stem(path: Path) -> str:
    return re.split(r"\.(?:mcap|db3)", path.name)[0]


def parts_of_one(folder: Path, files: Sequence[Path]) -> str:
    """Notice that the ``files`` of a folder without metadata.yaml are read as one recording.

    ``ros2 bag record`` names the parts of one NAME_0, NAME_1, … Parts that are missing are told. Raises InputError
    where several files have other names, or one number.
    """
    recordings, numbers, _ = zip(*map(_split, files), strict=True)
    names = shortened([path.name for path in files])
    twice = next((one for one, other in pairwise(files) if _split(one)[:2] == _split(other)[:2]), None)
    if twice is not None:
        raise InputError(f"{folder}: no {METADATA}, and {_stem(twice)} is there twice ({names}); remove one of the two")
    if len(set(recordings)) > 1 or not recordings[0].endswith("_") or numbers[0] != 0:
        raise InputError(
            f"{folder}: no {METADATA}, and {names} are no parts of one recording (NAME_0, NAME_1, …); give one of them"
            f" ({files[0]}); if they are, write {METADATA} with ros2 bag reindex"
        )
    missing = "" if numbers == (*range(len(files)),) else ", of which others are missing"
    return f"{folder}: no {METADATA}; {names} are read as the parts of one recording{missing}"
