"""Flat, row-major arrays of a message against shaped arrays of a dataclass.

A layout names the shape of every array field, e.g. ``{"poses": ("H", 7)}``. Dimensions become known in the order of
the layout: the first field that has a new letter fixes it, the later ones are checked against it.
"""

import math
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.messages.typestore import typestore

Layout = Mapping[str, tuple[str | int, ...]]
"""Message field -> shape; letters are dimensions, numbers are fixed sizes."""


def pack(type_name: str, layout: Layout, values: Mapping[str, Any]) -> dict[str, Any]:
    """Message fields from shaped arrays (or tuples of strings); raises ValueError where a shape is not the layout's."""
    sizes: dict[str, int] = {}
    return {name: _packed(type_name, name, shape, values[name], sizes) for name, shape in layout.items()}


def unpack(type_name: str, layout: Layout, message: Any, sizes: Mapping[str, int] | None = None) -> dict[str, Any]:
    """Shaped arrays (or tuples of strings) from message fields; raises InputError where the number of rows is wrong.

    ``sizes`` are dimensions that the message tells in fields of their own.
    """
    known = dict(sizes or {})
    return {name: _unpacked(type_name, name, shape, getattr(message, name), known) for name, shape in layout.items()}


def _packed(type_name: str, name: str, shape: tuple[str | int, ...], value: Any, sizes: dict[str, int]) -> Any:
    kind = element_types(type_name)[name]
    array = np.empty(len(value)) if kind == "string" else np.asarray(value)
    expected = tuple(
        sizes.setdefault(key, actual) if isinstance(key, str) else key
        for key, actual in zip(shape, array.shape, strict=False)
    )
    if array.shape != expected or array.ndim != len(shape):
        raise ValueError(f"{type_name}.{name}: shape {array.shape}, expected {_text(shape, sizes)}")
    return [str(item) for item in value] if kind == "string" else array.ravel().astype(kind, copy=False)


def _unpacked(type_name: str, name: str, shape: tuple[str | int, ...], value: Any, sizes: dict[str, int]) -> Any:
    unknown = [key for key in shape if isinstance(key, str) and key not in sizes]
    if unknown:
        rest = math.prod(sizes[key] if isinstance(key, str) else key for key in shape if key not in unknown)
        sizes[unknown[0]] = len(value) // rest if rest else 0
    expected = tuple(sizes[key] if isinstance(key, str) else key for key in shape)
    if math.prod(expected) != len(value):
        raise InputError(
            f"{type_name}.{name}: {len(value)} values, expected shape {_text(shape, sizes)};"
            " send every array with as many rows as the message's definition says"
        )
    if element_types(type_name)[name] == "string":
        return tuple(value)
    return np.array(value).reshape(expected)


def _text(shape: tuple[str | int, ...], sizes: Mapping[str, int]) -> str:
    return "(" + " x ".join(f"{key}={sizes.get(key, '?')}" if isinstance(key, str) else str(key) for key in shape) + ")"


@cache
def element_types(type_name: str) -> dict[str, str]:
    """Element type of every array field of a message, as numpy names it, or ``string``."""
    arrays = {}
    for name, (_, detail) in typestore().fielddefs[type_name][1]:
        if isinstance(detail, tuple) and isinstance(detail[0], tuple):
            arrays[name] = str(detail[0][1][0] if isinstance(detail[0][1], tuple) else detail[0][1])
    return arrays
