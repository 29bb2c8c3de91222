"""Sections, and what is in them, from values as a YAML file has them."""

import dataclasses
from collections.abc import Iterable
from typing import Any

from semantic_slam.configuration.checked_value import checked
from semantic_slam.errors import InputError


def build_section(cls: Any, values: Any, origin: str, prefix: str = "") -> Any:
    """Dataclass ``cls`` with ``values``; errors name their keys behind ``prefix``. Raises InputError."""
    if not isinstance(values, dict):
        raise InputError(f"{origin}: '{prefix.rstrip('.')}' must be a mapping; see config/default.yaml, or remove it")
    fields = {item.name: item for item in dataclasses.fields(cls)}
    values = _by_new_names(values, fields.values(), origin, prefix)
    unknown = sorted(set(values) - set(fields))
    if unknown:
        raise InputError(f"{origin}: unknown parameter '{prefix}{unknown[0]}'; known here: {', '.join(sorted(fields))}")
    return cls(**{name: _value(fields[name], value, origin, prefix) for name, value in values.items()})


def _by_new_names(values: dict[str, Any], fields: Iterable[Any], origin: str, prefix: str) -> dict[str, Any]:
    """Older names in a file or in the configuration of an older bag, as they are today."""
    today = {item.metadata["formerly"]: item.name for item in fields if "formerly" in item.metadata}
    for old in set(values) & set(today):
        if today[old] in values:
            raise InputError(f"{origin}: '{prefix}{old}' and '{prefix}{today[old]}' are one parameter; give the latter")
    return {today.get(name, name): value for name, value in values.items()}


def _value(item: Any, value: Any, origin: str, prefix: str) -> Any:
    name = f"{prefix}{item.name}"
    default = item.default if item.default is not dataclasses.MISSING else item.default_factory()
    if dataclasses.is_dataclass(default):
        return build_section(type(default), value, origin, f"{name}.")
    return checked(item, default, value, origin, name)
