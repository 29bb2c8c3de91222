"""Bytes of dataclasses, containers and arrays, equal to the last bit when read; reading them runs no code of theirs."""

import json
import struct
from dataclasses import fields, is_dataclass
from importlib import import_module
from math import prod
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array

PACKAGE = "semantic_slam.inference."
"""Where the dataclasses are that may be read."""
LENGTH = struct.Struct("<Q")
CONTAINERS: dict[str, type] = {"tuple": tuple, "list": list, "frozenset": frozenset}


def packed(value: Any) -> bytes:
    """The bytes of a value. Raises TypeError for what is neither a dataclass of the inference, container nor number."""
    arrays: list[Array] = []
    text = json.dumps(_tree(value, arrays)).encode()
    return LENGTH.pack(len(text)) + text + b"".join(array.tobytes("A") for array in arrays)


def unpacked(data: bytes) -> Any:
    """The value of :func:`packed` bytes. Raises ValueError for other bytes."""
    try:
        (length,) = LENGTH.unpack_from(data)
        end = LENGTH.size + length
        return _Reader(data, end).value(json.loads(data[LENGTH.size : end]))
    except (struct.error, LookupError, TypeError, AttributeError, ImportError, RecursionError) as fault:
        raise ValueError(f"no record of this version ({type(fault).__name__})") from None


def _tree(value: Any, arrays: list[Array]) -> Any:
    """JSON of a value: itself for a plain one, else a list of kind and contents; arrays follow the text."""
    if value is None or type(value) in (bool, int, float, str):
        return value
    if isinstance(value, np.ndarray | np.generic):
        return _array_tree(value, arrays)
    if isinstance(value, dict):
        return ["dict", [[_tree(key, arrays), _tree(own, arrays)] for key, own in value.items()]]
    kind = type(value)
    if kind.__name__ in CONTAINERS and kind is CONTAINERS[kind.__name__]:
        return [kind.__name__, [_tree(own, arrays) for own in value]]
    if not (is_dataclass(kind) and kind.__module__.startswith(PACKAGE)):
        raise TypeError(f"{kind.__module__}.{kind.__qualname__} has no record")
    told = {own.name: _tree(getattr(value, own.name), arrays) for own in fields(kind) if own.init}
    return ["object", kind.__module__, kind.__qualname__, told]


def _array_tree(value: Any, arrays: list[Array]) -> Any:
    """Type, shape and order in memory of an array or number, as sums over it may depend on that order."""
    if value.dtype.hasobject:
        raise TypeError("an array of objects has no record")
    if isinstance(value, np.generic):
        arrays.append(np.asarray(value))
        return ["number", value.dtype.str]
    order = "F" if value.flags.f_contiguous and not value.flags.c_contiguous else "C"
    arrays.append(value if order == "F" else np.ascontiguousarray(value))
    return ["array", value.dtype.str, list(value.shape), order]


class _Reader:
    """Reads values from their JSON, and their arrays one after the other from the bytes behind it."""

    def __init__(self, data: bytes, at: int) -> None:
        self._data, self._at = data, at

    def value(self, tree: Any) -> Any:
        """The value of a piece of JSON."""
        if not isinstance(tree, list):
            return tree
        kind, *told = tree
        if kind == "array":
            dtype, shape, order = told
            return self._numbers(dtype, prod(shape)).reshape(shape, order=order).copy(order)
        if kind == "number":
            return self._numbers(told[0], 1)[0]
        if kind == "dict":
            return {self.value(key): self.value(own) for key, own in told[0]}
        if kind == "object":
            return self._object(*told)
        return CONTAINERS[kind](self.value(own) for own in told[0])

    def _numbers(self, dtype: str, count: int) -> Any:
        found = np.frombuffer(self._data, np.dtype(dtype), count, self._at)
        self._at += found.nbytes
        return found

    def _object(self, module: str, name: str, told: dict[str, Any]) -> Any:
        if not module.startswith(PACKAGE):
            raise TypeError(f"{module} has no records")
        kind = getattr(import_module(module), name)
        if not (isinstance(kind, type) and is_dataclass(kind)):
            raise TypeError(f"{name} has no records")
        return kind(**{field: self.value(own) for field, own in told.items()})
