"""Mapping between message fields (flat row-major arrays, plain values) and dataclass fields (shaped arrays).

A layout gives the shape of every array field, e.g. ``{"poses": ("H", 7)}``. Dimensions are resolved in the order of the
layout: the first field with a new letter fixes its size, later fields are checked against it. A letter may carry a
``+1``. An array of shape :class:`MayBeEmpty` has no values where it was not given, both on the wire and after
unpacking; the receiving dataclass decides what that means (NaN for ours).
"""

import math
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype

from semantic_slam.errors import MessageError
from semantic_slam.messages.typestore import message_class, typestore

Shape = tuple[str | int, ...]
Layout = Mapping[str, Shape]
"""Message field -> shape; letters are dimensions, numbers are fixed sizes."""


class MayBeEmpty(tuple[str | int, ...]):
    """Shape of an optional float array."""


def filled(type_name: str, layout: Layout, values: Mapping[str, Any], **fields: Any) -> Any:
    """Build a message from shaped arrays, tuples of strings and plain values; ``fields`` are nested messages."""
    return message_class(type_name)(**fields, **plain_values(type_name, values), **pack(type_name, layout, values))


def contents(type_name: str, layout: Layout, message: Any, sizes: Mapping[str, int] | None = None) -> dict[str, Any]:
    """Shaped arrays, tuples of strings and plain values of a message; ``sizes`` as in :func:`unpack`."""
    return plain_values(type_name, vars(message)) | unpack(type_name, layout, message, sizes)


def plain_values(type_name: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Values of the message's scalar fields, converted to their types."""
    return {name: kind(values[name]) for name, kind in plain_types(type_name).items()}


def pack(type_name: str, layout: Layout, values: Mapping[str, Any]) -> dict[str, Any]:
    """Message fields from shaped arrays (or tuples of strings). Raises ValueError where a shape violates the layout."""
    sizes: dict[str, int] = {}
    return {name: _packed(type_name, name, shape, values[name], sizes) for name, shape in layout.items()}


def unpack(type_name: str, layout: Layout, message: Any, sizes: Mapping[str, int] | None = None) -> dict[str, Any]:
    """Shaped arrays (or tuples of strings) from message fields; raises MessageError where the number of rows is wrong.

    ``sizes`` are dimensions given by separate fields of the message.
    """
    known: dict[str, int] = {}
    for letter, size in (sizes or {}).items():
        _learn(known, letter, size)
    return {name: _unpacked(type_name, name, shape, getattr(message, name), known) for name, shape in layout.items()}


def _packed(type_name: str, name: str, shape: Shape, value: Any, sizes: dict[str, int]) -> Any:
    kind = element_types(type_name)[name]
    array = np.empty(len(value)) if kind == "string" else np.asarray(value)
    if isinstance(shape, MayBeEmpty) and _says_nothing(array, shape, sizes):
        return np.zeros(0, dtype=kind)
    for key, actual in zip(shape, array.shape, strict=False):
        if isinstance(key, str) and key not in sizes:
            _learn(sizes, key, actual)
    if array.shape != tuple(sizes[key] if isinstance(key, str) else key for key in shape):
        raise ValueError(f"{type_name}.{name}: shape {array.shape}, expected {_text(shape, sizes)}")
    return [str(item) for item in value] if kind == "string" else array.ravel().astype(kind, copy=False)


def _says_nothing(array: Any, shape: Shape, sizes: dict[str, int]) -> bool:
    """Whether an array is empty, or all NaN where its size is known from other fields."""
    if not array.size:
        return True
    is_known = all(isinstance(key, int) or key in sizes for key in shape)
    return is_known and bool(np.isnan(array).all())


def _unpacked(type_name: str, name: str, shape: Shape, value: Any, sizes: dict[str, int]) -> Any:
    if isinstance(shape, MayBeEmpty) and not len(value):
        return np.zeros(0)
    unknown = [key for key in shape if isinstance(key, str) and key not in sizes]
    if unknown:
        rest = math.prod(sizes[key] if isinstance(key, str) else key for key in shape if key not in unknown)
        _learn(sizes, unknown[0], len(value) // rest if rest else 0)
    expected = tuple(sizes[key] if isinstance(key, str) else key for key in shape)
    if math.prod(expected) != len(value):
        raise MessageError(
            f"{type_name}.{name}: {len(value)} values, expected shape {_text(shape, sizes)};"
            " send every array with as many rows as the message's definition says",
            f"array {name} of another length",
        )
    if element_types(type_name)[name] == "string":
        return tuple(value)
    return np.array(value).reshape(expected)


def _learn(sizes: dict[str, int], letter: str, size: int) -> None:
    sizes[letter], sizes[f"{letter}+1"] = size, size + 1


def _text(shape: Shape, sizes: dict[str, int]) -> str:
    return "(" + " x ".join(f"{key}={sizes.get(key, '?')}" if isinstance(key, str) else str(key) for key in shape) + ")"


@cache
def element_types(type_name: str) -> dict[str, str]:
    """Element type of every array field of a message, as numpy names it, or ``string``."""
    arrays = {}
    for name, (_, detail) in typestore().fielddefs[type_name][1]:
        if isinstance(detail, tuple) and isinstance(detail[0], tuple):
            arrays[name] = str(detail[0][1][0] if isinstance(detail[0][1], tuple) else detail[0][1])
    return arrays


@cache
def plain_types(type_name: str) -> dict[str, Callable[[Any], Any]]:
    """Python type of every scalar field of a message (number, boolean or string)."""
    return {
        name: _python_type(detail[0])
        for name, (node, detail) in typestore().fielddefs[type_name][1]
        if node == Nodetype.BASE
    }


def _python_type(name: str) -> Callable[[Any], Any]:
    if name in ("bool", "string"):
        return {"bool": bool, "string": str}[name]
    return float if name.startswith("float") else int
