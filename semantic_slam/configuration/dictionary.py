"""Configurations as nested plain dictionaries: what YAML files, messages and saved results have."""

import dataclasses
from typing import Any

from semantic_slam.configuration.configuration import Configuration
from semantic_slam.configuration.sections import build_section


def to_dict(configuration: Any) -> dict[str, Any]:
    """Nested plain dictionary: what is saved with every result."""
    plain = dataclasses.asdict(configuration)
    return {key: _plain(value) for key, value in plain.items()}


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return list(value) if isinstance(value, tuple) else value


def from_dict(values: dict[str, Any], origin: str = "configuration") -> Configuration:
    """Configuration from a nested dictionary; keys left out keep their default. Raises InputError."""
    configuration: Configuration = build_section(Configuration, values, origin)
    return configuration
