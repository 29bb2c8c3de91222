"""A value in the type of its field and inside its limits."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar, get_args

from semantic_slam.errors import InputError
from semantic_slam.registry import Registry

T = TypeVar("T")
LARGEST = 1e15
"""Largest number that is not infinite: squares of larger ones leave no digit of others."""


def choices_of(item: Any) -> tuple[str, ...]:
    """Values that a field admits by name, some of which foreign packages may add; () where it admits any."""
    choices = item.metadata.get("choices", ())
    return choices.names() if isinstance(choices, Registry) else tuple(choices)


def checked(item: Any, default: Any, value: Any, origin: str, name: str) -> Any:
    """``value`` in the type of the field ``item`` and inside its limits; raises InputError."""
    try:
        result = _convert(default, value, item.type)
    except (TypeError, ValueError, OverflowError):
        given = repr(value)[:80]
        raise InputError(
            f"{origin}: parameter '{name}' has a wrong type ({given}); an example is {default!r}"
        ) from None
    limits = item.metadata
    choices = choices_of(item)
    if choices and result not in choices:
        raise InputError(f"{origin}: parameter '{name}' is {result!r}; choose one of {', '.join(choices)}")
    if "lengths" in limits and len(result) not in limits["lengths"]:
        raise InputError(
            f"{origin}: parameter '{name}' has {len(result)} numbers;"
            f" give {' or '.join(str(length) for length in limits['lengths'])}"
        )
    if result < limits.get("minimum", result) or result > limits.get("maximum", result):
        raise InputError(
            f"{origin}: parameter '{name}' is {result}; it must lie in"
            f" [{limits.get('minimum', '-inf')}, {limits.get('maximum', 'inf')}]"
        )
    _check_size(limits, result, f"{origin}: parameter '{name}'")
    if limits.get("distinct", False) and (again := first_repeated(result)) is not None:
        raise InputError(f"{origin}: parameter '{name}' has {again!r} twice, which would count twice; leave one out")
    return result


def first_repeated(values: Sequence[T]) -> T | None:
    """The first value that is equal to an earlier one; None where there is none."""
    return next((value for place, value in enumerate(values) if value in values[:place]), None)


def _check_size(limits: Mapping[str, Any], value: Any, named: str) -> None:
    """Raises InputError for a number of ``value`` that is too large, or infinite where that means nothing."""
    largest, infinite = limits.get("maximum", LARGEST), limits.get("infinite", False)
    for number in value if isinstance(value, tuple) else (value,):
        if isinstance(number, float) and abs(number) > largest and not (infinite and number == math.inf):
            raise InputError(
                f"{named} is {value}; give numbers of at most {largest:g}{', or .inf' if infinite else ''}"
            )


def _convert(default: Any, value: Any, kind: Any) -> Any:
    if isinstance(default, bool):
        if not isinstance(value, bool):
            raise TypeError
        return value
    if isinstance(default, tuple):
        if isinstance(value, str):
            raise TypeError
        (of, *_) = get_args(kind)
        return tuple(_convert(of(), item, of) for item in value)
    if isinstance(default, float) and (isinstance(value, bool) or value != value):
        raise TypeError
    if isinstance(default, str) and not isinstance(value, str):
        raise TypeError
    if isinstance(default, int) and int(value) != value:
        raise TypeError
    return type(default)(value)
