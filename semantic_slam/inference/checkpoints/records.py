"""Bytes of dataclasses, containers and arrays, equal to the last bit when read; reading them runs no code of theirs."""

import json
import struct
from array import array
from collections import Counter, OrderedDict, deque
from dataclasses import fields, is_dataclass
from importlib import import_module
from math import prod
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.checkpoints.lineage_table import LineageTable
from semantic_slam.inference.states.lineage import LineageStep

PACKAGES = tuple(
    f"semantic_slam.{name}."
    for name in ("configuration", "inference", "messages", "perception", "pipeline", "viewpoint")
)
"""Where the dataclasses are that may be read."""
LENGTH = struct.Struct("<Q")
CONTAINERS: dict[str, type] = {"tuple": tuple, "list": list, "set": set, "frozenset": frozenset}
MAPPINGS: dict[str, type] = {"dict": dict, "Counter": Counter, "OrderedDict": OrderedDict}


def packed(value: Any) -> bytes:
    """The bytes of a value. Raises TypeError for what is neither a dataclass of this package, container nor number."""
    writer = _Writer()
    tree = writer.tree(value)
    columns = _Writer()
    text = json.dumps([columns.tree(writer.lineages.columns()), tree]).encode()
    return LENGTH.pack(len(text)) + text + b"".join(own.tobytes("A") for own in (*columns.arrays, *writer.arrays))


def unpacked(data: bytes) -> Any:
    """The value of :func:`packed` bytes. Raises ValueError for other bytes."""
    try:
        (length,) = LENGTH.unpack_from(data)
        end = LENGTH.size + length
        columns, tree = json.loads(data[LENGTH.size : end])
        reader = _Reader(data, end)
        reader.lineages = LineageTable.of(reader.value(columns))
        return reader.value(tree)
    except (struct.error, LookupError, ValueError, TypeError, AttributeError, ImportError, RecursionError) as fault:
        raise ValueError(f"no record of this version ({type(fault).__name__})") from None


def _is_lineage(value: Any) -> bool:
    return type(value) is tuple and bool(value) and type(value[0]) is LineageStep


class _Writer:
    """Makes JSON of values; arrays and lineages are collected beside it."""

    def __init__(self) -> None:
        self.arrays: list[Array] = []
        self.lineages = LineageTable()

    def tree(self, value: Any) -> Any:
        """JSON of a value: itself for a plain one, else a list of kind and contents."""
        if value is None or type(value) in (bool, int, float, str):
            return value
        if isinstance(value, np.ndarray | np.generic):
            return self._array(value)
        if _is_lineage(value):
            return ["lineage", self._array(self.lineages.rows(value))]
        kind = type(value)
        if MAPPINGS.get(kind.__name__) is kind:
            return [kind.__name__, [[self.tree(key), self.tree(own)] for key, own in value.items()]]
        if CONTAINERS.get(kind.__name__) is kind:
            every = sorted(value, key=repr) if kind in (set, frozenset) else value
            return [kind.__name__, [self.tree(own) for own in every]]
        if kind is deque:
            return ["deque", [self.tree(own) for own in value], value.maxlen]
        if kind is array:
            return ["numbers", value.typecode, self._array(np.array(value, dtype=value.typecode))]
        if kind is bytes:
            return ["bytes", self._array(np.frombuffer(value, np.uint8))]
        return self._object(value)

    def _object(self, value: Any) -> Any:
        kind = type(value)
        if not (is_dataclass(kind) and kind.__module__.startswith(PACKAGES)):
            raise TypeError(f"{kind.__module__}.{kind.__qualname__} has no record")
        entries = {own.name: self.tree(getattr(value, own.name)) for own in fields(kind) if own.init}
        return ["object", kind.__module__, kind.__qualname__, entries]

    def _array(self, value: Any) -> Any:
        """Type, shape and order in memory of an array or number, as sums over it may depend on that order."""
        if value.dtype.hasobject:
            raise TypeError("an array of objects has no record")
        if isinstance(value, np.generic):
            self.arrays.append(np.asarray(value))
            return ["number", value.dtype.str]
        order = "F" if value.flags.f_contiguous and not value.flags.c_contiguous else "C"
        self.arrays.append(value if order == "F" else np.ascontiguousarray(value))
        return ["array", value.dtype.str, list(value.shape), order]


class _Reader:
    """Reads values from their JSON, and their arrays one after the other from the bytes behind it."""

    def __init__(self, data: bytes, at: int) -> None:
        self._data, self._at = data, at
        self.lineages = LineageTable()

    def value(self, tree: Any) -> Any:
        """The value of a piece of JSON."""
        if not isinstance(tree, list):
            return tree
        kind, *entries = tree
        if kind == "array":
            dtype, shape, order = entries
            return self._numbers(dtype, prod(shape)).reshape(shape, order=order).copy(order)
        if kind == "number":
            return self._numbers(entries[0], 1)[0]
        if kind == "lineage":
            return self.lineages.lineage(self.value(entries[0]))
        if kind in MAPPINGS:
            return MAPPINGS[kind]({self.value(key): self.value(own) for key, own in entries[0]})
        if kind == "deque":
            return deque([self.value(own) for own in entries[0]], maxlen=entries[1])
        if kind == "numbers":
            return array(entries[0], self.value(entries[1]).tobytes())
        if kind == "bytes":
            return self.value(entries[0]).tobytes()
        if kind == "object":
            return self._object(*entries)
        return CONTAINERS[kind](self.value(own) for own in entries[0])

    def _numbers(self, dtype: str, count: int) -> Any:
        found = np.frombuffer(self._data, np.dtype(dtype), count, self._at)
        self._at += found.nbytes
        return found

    def _object(self, module: str, name: str, entries: dict[str, Any]) -> Any:
        if not module.startswith(PACKAGES):
            raise TypeError(f"{module} has no records")
        kind = getattr(import_module(module), name)
        if not (isinstance(kind, type) and is_dataclass(kind)):
            raise TypeError(f"{name} has no records")
        return kind(**{field: self.value(own) for field, own in entries.items()})
