"""Selection and joining of rows in dataclasses whose fields have one row for each item."""

from collections.abc import Collection, Sequence
from dataclasses import fields, replace
from itertools import chain
from typing import Any, TypeVar

import numpy as np

from semantic_slam.geometry.arrays import Index

Rows = TypeVar("Rows")


def with_rows(value: Rows, rows: Index, whole: Collection[str]) -> Rows:
    """``value`` with the ``rows`` of its arrays and tuples; the fields in ``whole`` have no rows and stay."""
    names = [item.name for item in fields(value) if item.name not in whole]  # type: ignore[arg-type]
    return replace(value, **{name: _taken(getattr(value, name), rows) for name in names})  # type: ignore[type-var]


def joined_rows(values: Sequence[Rows], whole: Collection[str]) -> Rows:
    """The rows of several, one after the other; the fields in ``whole`` are those of the first."""
    names = [item.name for item in fields(values[0]) if item.name not in whole]  # type: ignore[arg-type]
    joined = {name: _joined([getattr(value, name) for value in values]) for name in names}
    return replace(values[0], **joined)  # type: ignore[type-var]


def _joined(parts: list[Any]) -> Any:
    return tuple(chain.from_iterable(parts)) if isinstance(parts[0], tuple) else np.concatenate(parts)


def _taken(values: Any, rows: Index) -> Any:
    return tuple(values[row] for row in rows) if isinstance(values, tuple) else values[rows]
