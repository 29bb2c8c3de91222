"""Bytes, texts and values as nobody should send them; every draw is of the generator that is given."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.random import Generator

STRANGE_NUMBERS: tuple[Any, ...] = (
    0,
    -1,
    1,
    2,
    -5.0,
    1e-300,
    1e300,
    -1e300,
    float("nan"),
    float("inf"),
    float("-inf"),
    2**31,
    2**32,
    2**63,
    -(2**63),
    10**400,
)
EXTREME_NUMBERS = (0.0, 1e-300, 1e-30, 1e-9, 1.0, 1e3, 1e9, 1e30, 1e300, -1e-9, -1.0)
STRANGE_VALUES: tuple[Any, ...] = (None, True, "", "0", "nan", "\x00", "none", [], {}, [[]], [None], {"": 0}, "ä" * 300)
STRANGE_BYTES = (
    b"\x00" * 4,
    b"\xff" * 4,
    b"\xff" * 8,
    b"\x7f\xff\xff\xff",
    b"\x00" * 64,
    b"\xfe\xff",
    b"nan",
    b"-",
    b"1e999",
)


def damaged(data: bytes, chance: Generator) -> bytes:
    """One to four damages of bytes: bits, runs, cuts, copies."""
    for _ in range(1 + chance.integers(4)):
        if data:
            data = _damage(chance)(bytearray(data), chance)
    return data


def _damage(chance: Generator) -> Callable[[bytearray, Generator], bytes]:
    kinds = (_flip_bit, _flip_bit, _overwrite, _overwrite, _cut_off, _cut_out, _repeat, _insert)
    return kinds[chance.integers(len(kinds))]


def _flip_bit(data: bytearray, chance: Generator) -> bytes:
    data[chance.integers(len(data))] ^= 1 << int(chance.integers(8))
    return bytes(data)


def _overwrite(data: bytearray, chance: Generator) -> bytes:
    at, new = chance.integers(len(data)), STRANGE_BYTES[chance.integers(len(STRANGE_BYTES))]
    data[at : at + len(new)] = new
    return bytes(data)


def _cut_off(data: bytearray, chance: Generator) -> bytes:
    return bytes(data[: chance.integers(len(data))])


def _cut_out(data: bytearray, chance: Generator) -> bytes:
    at = chance.integers(len(data))
    del data[at : at + 1 + chance.integers(64)]
    return bytes(data)


def _repeat(data: bytearray, chance: Generator) -> bytes:
    at = chance.integers(len(data))
    piece = data[at : at + 1 + chance.integers(64)]
    return bytes(data[:at] + piece * int(1 + chance.integers(8)) + data[at:])


def _insert(data: bytearray, chance: Generator) -> bytes:
    at, new = chance.integers(len(data)), chance.bytes(1 + int(chance.integers(16)))
    return bytes(data[:at] + new + data[at:])


def strange(chance: Generator) -> Any:
    """A value that is seldom meant."""
    values = STRANGE_NUMBERS + STRANGE_VALUES
    return values[chance.integers(len(values))]


def with_strange_values(document: Any, chance: Generator) -> Any:
    """A copy of nested dictionaries and lists in which one to three values, or keys, are strange."""
    for _ in range(1 + chance.integers(3)):
        document = _changed(document, chance)
    return document


def with_extreme_numbers(document: Any, chance: Generator) -> Any:
    """A copy of nested dictionaries and lists in which one to three numbers are far too small or too large."""
    for _ in range(1 + chance.integers(3)):
        document = _with_extreme_number(document, chance)
    return document


def _with_extreme_number(value: Any, chance: Generator) -> Any:
    if isinstance(value, dict) and value:
        key = list(value)[chance.integers(len(value))]
        return {**value, key: _with_extreme_number(value[key], chance)}
    if isinstance(value, list) and value:
        at = int(chance.integers(len(value)))
        return [*value[:at], _with_extreme_number(value[at], chance), *value[at + 1 :]]
    if isinstance(value, bool) or not isinstance(value, int | float):
        return value
    extreme = EXTREME_NUMBERS[chance.integers(len(EXTREME_NUMBERS))]
    return int(extreme) if isinstance(value, int) and abs(extreme) >= 1.0 else extreme


def _changed(value: Any, chance: Generator) -> Any:
    if isinstance(value, dict) and value and chance.random() < 0.95:
        return _changed_mapping(value, chance)
    if isinstance(value, list) and value and chance.random() < 0.9:
        return _changed_list(value, chance)
    return strange(chance)


def _changed_mapping(value: dict[Any, Any], chance: Generator) -> dict[Any, Any]:
    key = list(value)[chance.integers(len(value))]
    what = chance.random()
    if what < 0.05:
        return {other: item for other, item in value.items() if other != key}
    if what < 0.1:
        return {**value, f"{key}x": value[key]}
    return {**value, key: _changed(value[key], chance)}


def _changed_list(value: list[Any], chance: Generator) -> list[Any]:
    at, what = int(chance.integers(len(value))), chance.random()
    if what < 0.1:
        return value[:at]
    if what < 0.2:
        return [*value, *value[at:]]
    return [*value[:at], _changed(value[at], chance), *value[at + 1 :]]


def change_message(message: Any, chance: Generator) -> None:
    """Make one leaf of a message strange, in place: a number, a text, or an element or the length of an array."""
    name = list(vars(message))[chance.integers(len(vars(message)))]
    value = getattr(message, name)
    if hasattr(value, "__msgtype__"):
        change_message(value, chance)
    elif isinstance(value, np.ndarray):
        setattr(message, name, _changed_array(value, chance))
    elif isinstance(value, list):
        _change_rows(message, name, value, chance)
    elif isinstance(value, str):
        setattr(message, name, ("", "\x00", "nan", "ä" * 99)[chance.integers(4)])
    elif isinstance(value, float):
        setattr(message, name, float(np.float64(STRANGE_NUMBERS[chance.integers(len(STRANGE_NUMBERS) - 1)])))
    elif isinstance(value, bool):
        setattr(message, name, not value)
    elif isinstance(value, int):
        setattr(message, name, int((0, 1, value + 1, max(value - 1, 0), 2**31 - 1)[chance.integers(5)]))


def _change_rows(message: Any, name: str, value: list[Any], chance: Generator) -> None:
    if value and hasattr(value[0], "__msgtype__") and chance.random() < 0.7:
        change_message(value[chance.integers(len(value))], chance)
    else:
        at = int(chance.integers(len(value) + 1))
        setattr(message, name, value[:at] if chance.random() < 0.5 else [*value, *value[at:]])


def _changed_array(value: Any, chance: Generator) -> Any:
    what = chance.random()
    if what < 0.2 or not len(value):
        return value[: chance.integers(len(value) + 1)]
    if what < 0.35:
        return np.concatenate([value, value[: 1 + chance.integers(len(value))]])
    changed = value.copy()
    with np.errstate(all="ignore"):
        if value.dtype.kind == "f":
            changed[chance.integers(len(value))] = STRANGE_NUMBERS[chance.integers(len(STRANGE_NUMBERS) - 1)]
        elif value.dtype.kind in "iu":
            limits = np.iinfo(value.dtype)
            changed[chance.integers(len(value))] = (limits.min, limits.max, 0, 1)[chance.integers(4)]
    return changed
