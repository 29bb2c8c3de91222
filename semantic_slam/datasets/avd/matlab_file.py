"""Reading of MATLAB files, with the uncompressed size bounded before anything is read."""

import json
import struct
import subprocess
import sys
import zlib
from pathlib import Path
from typing import Any

from semantic_slam.errors import InputError, one_line

MOST_BYTES = 200_000_000
"""Bytes that the variables of a file may have; a real scene of a thousand pictures has a megabyte."""
HEADER, COMPRESSED = 128, 15
"""Bytes before the first element of a file of version 5, and the type of compressed elements."""


def read_matlab(path: Path) -> dict[str, Any]:
    """Name -> value: structs as dictionaries, arrays as nested lists. Raises InputError that names the file."""
    try:
        is_large = path.stat().st_size > MOST_BYTES or _unpacked_size(path.read_bytes()) > MOST_BYTES
    except (OSError, zlib.error) as fault:
        raise unreadable(path, fault) from None
    if is_large:
        raise InputError(f"{path}: holds more than {MOST_BYTES // 10**6} MB; restore it from the data set")
    return _read_apart(path)


def _read_apart(path: Path) -> dict[str, Any]:
    """Variables of a file, read in a process of its own."""
    reader = [sys.executable, "-P", "-m", "semantic_slam.datasets.avd.matlab_reader", str(path)]
    done = subprocess.run(reader, capture_output=True, text=True, check=False)
    if done.returncode:
        lines = done.stderr.strip().splitlines()
        raise unreadable(path, lines[-1] if lines else f"its reader ended with code {done.returncode}")
    return dict(json.loads(done.stdout))


def unreadable(path: Path, fault: BaseException | str) -> InputError:
    """What to say of a file that is not what it should be."""
    reason = one_line(fault) or type(fault).__name__
    return InputError(f"{path}: not a readable {path.name} ({reason}); restore it from the data set")


def _unpacked_size(content: bytes) -> int:
    """Bytes of all elements of a file of version 5, compressed ones unpacked, as far as MOST_BYTES; 0 for version 4."""
    if 0 in content[:4]:
        return 0  # of version 4, which knows no compression
    order = "<II" if content[HEADER - 2 : HEADER] == b"IM" else ">II"  # as scipy takes it, whatever stands there
    total, at = 0, HEADER
    while at + 8 <= len(content) and total <= MOST_BYTES:
        kind, size = struct.unpack_from(order, content, at)
        element = content[at + 8 : at + 8 + size]
        total += _inflated_size(element, MOST_BYTES - total) if kind == COMPRESSED else len(element)
        at += 8 + size
    return total


def _inflated_size(packed: bytes, limit: int) -> int:
    """Bytes that a zlib stream unpacks to, or more than ``limit``. Raises zlib.error."""
    stream, total = zlib.decompressobj(), 0
    while packed and not stream.eof and total <= limit:
        total += len(stream.decompress(packed, 1 << 20))
        packed = stream.unconsumed_tail
    return total
