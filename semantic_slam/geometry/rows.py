"""Row selection for tables: dataclasses whose arrays (and tuples) share their first axis."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import Field, fields, replace
from itertools import chain
from typing import Any, ClassVar, Protocol, TypeVar

import numpy as np

from semantic_slam.geometry.arrays import Flags, Index


class Dataclass(Protocol):
    """Any dataclass."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]


Table = TypeVar("Table", bound=Dataclass)

Selection = Index | Flags | slice
"""Selection of rows: indices (repeats allowed), a boolean mask, or a slice."""


def take(table: Table, selection: Selection, names: Iterable[str] = ()) -> Table:
    """Select rows of a table, in all fields or those in ``names``; None and the other fields are kept.

    A field is an array or itself a table. Attributes are set without calling the constructor: it would repeat checks
    that hold for the whole table already, and costs more than selecting a few rows.
    """
    some: Table = object.__new__(type(table))
    known, part = table.__dict__, some.__dict__
    if names:
        part.update((name, known[name]) for name in table.__dataclass_fields__)
    for name in names or table.__dataclass_fields__:
        value = known[name]
        part[name] = value[selection] if type(value) is np.ndarray else _rest(value, selection)
    return some


def _rest(value: Any, selection: Selection) -> Any:
    """Select rows of a field that is not an array: a table, or None."""
    return None if value is None else take(value, selection)


def with_rows(value: Table, rows: Index, whole: Collection[str]) -> Table:
    """``value`` with only ``rows`` of its arrays and tuples; the fields in ``whole`` have no rows and are kept."""
    names = [item.name for item in fields(value) if item.name not in whole]
    return replace(value, **{name: _taken(getattr(value, name), rows) for name in names})


def joined_rows(values: Sequence[Table], whole: Collection[str]) -> Table:
    """Concatenate the rows of several tables; the fields in ``whole`` are taken from the first."""
    names = [item.name for item in fields(values[0]) if item.name not in whole]
    joined = {name: _joined([getattr(value, name) for value in values]) for name in names}
    return replace(values[0], **joined)


def _joined(parts: list[Any]) -> Any:
    return tuple(chain.from_iterable(parts)) if isinstance(parts[0], tuple) else np.concatenate(parts)


def _taken(values: Any, rows: Index) -> Any:
    return tuple(values[row] for row in rows) if isinstance(values, tuple) else values[rows]
