"""Rows of tables: dataclasses whose arrays (and tuples) have a row for each of the same things."""

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
"""Which rows: their indices, any number of times; a mask; a range."""


def take(table: Table, selection: Selection, names: Iterable[str] = ()) -> Table:
    """The rows of a selection, in all fields or in those of ``names``; what is None, and the other fields, stay.

    A field is an array or a table itself. Attributes are set without the class's own constructor, which checks again
    what is known of the whole and takes longer than the selection of a few rows.
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
    """A selection of a field that is no array: a table, or None."""
    return None if value is None else take(value, selection)


def with_rows(value: Table, rows: Index, whole: Collection[str]) -> Table:
    """``value`` with the ``rows`` of its arrays and tuples; the fields in ``whole`` have no rows and stay."""
    names = [item.name for item in fields(value) if item.name not in whole]
    return replace(value, **{name: _taken(getattr(value, name), rows) for name in names})


def joined_rows(values: Sequence[Table], whole: Collection[str]) -> Table:
    """The rows of several, one after the other; the fields in ``whole`` are those of the first."""
    names = [item.name for item in fields(values[0]) if item.name not in whole]
    joined = {name: _joined([getattr(value, name) for value in values]) for name in names}
    return replace(values[0], **joined)


def _joined(parts: list[Any]) -> Any:
    return tuple(chain.from_iterable(parts)) if isinstance(parts[0], tuple) else np.concatenate(parts)


def _taken(values: Any, rows: Index) -> Any:
    return tuple(values[row] for row in rows) if isinstance(values, tuple) else values[rows]
