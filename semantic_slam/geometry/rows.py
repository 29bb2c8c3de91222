"""Selections of tables: frozen dataclasses whose arrays have a row for each of the same things."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from semantic_slam.geometry.arrays import Flags, Index

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    Table = TypeVar("Table", bound=DataclassInstance)

Selection = Index | Flags | slice
"""Which rows: their indices, any number of times; a mask; a range."""


def take(table: "Table", selection: Selection, names: Iterable[str] = ()) -> "Table":
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
    """Selection from a field that is no array: None stays, a table gives its own rows."""
    return None if value is None else take(value, selection)
