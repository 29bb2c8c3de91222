"""Text files of numbers, compressed by gzip or not, whose faults are named by their lines."""

import gzip
import math
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array

MICROSECONDS = 1_000_000


@dataclass(frozen=True)
class Line:
    """One line with words on it."""

    path: Path
    number: int  # 1, 2, ...
    words: list[str]

    def fault(self, text: str, remedy: str) -> InputError:
        """An error that names the file and the line."""
        return InputError(f"{self.path}, line {self.number}: {text}; {remedy}")


def found(folder: Path, name: str) -> Path:
    """``name`` in a folder, or ``name``.gz; raises InputError where neither is there."""
    path = found_or_none(folder, name)
    if path is None:
        raise InputError(f"{folder / name}: not there, nor with .gz; name the folder that holds it")
    return path


def found_or_none(folder: Path, name: str) -> Path | None:
    """``name`` in a folder, or ``name``.gz; None where neither is there."""
    return next((path for path in (folder / name, folder / f"{name}.gz") if path.is_file()), None)


def lines_of(path: Path, remedy: str, separator: str | None = None) -> Iterator[Line]:
    """Lines that are neither empty nor comments (#), split into words. Raises InputError that ends with ``remedy``."""
    try:
        with _opened(path) as file:
            for number, text in enumerate(file, start=1):
                text = text.strip()
                if text and not text.startswith("#"):
                    words = text.split(separator)
                    yield Line(path, number, words if separator is None else [word.strip() for word in words])
    except (OSError, EOFError, UnicodeDecodeError, zlib.error) as fault:
        raise InputError(f"{path}: cannot be read to its end ({fault}); {remedy}") from None


def _opened(path: Path) -> TextIO:
    """The text of a file, without the byte-order mark that spreadsheets put in front."""
    encoding = "utf-8-sig"
    return gzip.open(path, "rt", encoding=encoding) if path.suffix == ".gz" else path.open(encoding=encoding)


def numbers(line: Line, columns: Sequence[str], remedy: str) -> list[float]:
    """The numbers of ``columns``, in the order of the line's words. Raises InputError."""
    if len(line.words) < len(columns):
        raise line.fault(f"{len(line.words)} columns, expected {' '.join(columns)}", remedy)
    values = []
    for word, column in zip(line.words, columns, strict=False):
        try:
            value = float(word)
        except ValueError:
            value = float("nan")
        if not math.isfinite(value):
            raise line.fault(f"{column} is '{word}', not a finite number", remedy)
        values.append(value)
    return values


def table(path: Path, columns: Sequence[str], remedy: str, *, time: bool = True, separator: str | None = None) -> Array:
    """(N, columns) all numbers of a file; with ``time`` the first column must not run backwards. Raises InputError."""
    rows: list[list[float]] = []
    for line in lines_of(path, remedy, separator):
        rows.append(numbers(line, columns, remedy))
        if time and len(rows) > 1 and rows[-1][0] < rows[-2][0]:
            raise line.fault(f"time goes backwards, from {rows[-2][0]:.6f} to {rows[-1][0]:.6f}", "sort its lines")
    if not rows:
        raise InputError(f"{path}: no numbers in it; {remedy}")
    return np.array(rows)


def nanoseconds(seconds: Array) -> NDArray[np.int64]:
    """Stamps of times in seconds, to the microsecond: as exact as a float holds those since 1970."""
    return np.round(np.asarray(seconds) * MICROSECONDS).astype(np.int64) * 1000
