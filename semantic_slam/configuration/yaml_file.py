"""Configurations from YAML files, plain or in the form of ROS 2 parameter files."""

import re
from pathlib import Path
from typing import Any

from semantic_slam.configuration.configuration import Configuration
from semantic_slam.configuration.dictionary import from_dict
from semantic_slam.errors import InputError
from semantic_slam.text_files import parse_yaml, read_text

REMEDY = "see config/default.yaml"
OUR_NODE = re.compile(r"(^|/)(hypothesis_manager|classifier|bag_player|bag_recorder|backend_\d+)$")


OTHERS_ELSEWHERE = "and those of a node alone (backends, use_sim_time, ...) into another file"
DEEPEST = 8
"""Levels of namespaces and names of nodes that are looked through for ``ros__parameters``."""


def load_configuration(path: str | Path) -> Configuration:
    """Configuration from a YAML file, plain or in the form of a ROS 2 parameter file. Raises InputError."""
    path = Path(path)
    values = parse_yaml(read_text(path, REMEDY), str(path), REMEDY) or {}
    if not isinstance(values, dict):
        raise InputError(f"{path}: a mapping is expected; {REMEDY}")
    if "/**" in values:
        for key in ("/**", "ros__parameters"):
            _check_alone(values, key, path)
            values = values.get(key) or {}
            if not isinstance(values, dict):
                raise InputError(f"{path}: '{key}' must be a mapping; {REMEDY}")
        _check_readable_by_nodes(values, path)
    elif addressed := [str(key) for key, value in values.items() if _is_of_nodes(key, value)]:
        raise InputError(
            f"{path}: its parameters stand below '{addressed[0][:80]}', for nodes of that name alone; commands have no"
            f" such name: put the configuration's below '/**:' and 'ros__parameters:', {OTHERS_ELSEWHERE}"
        )
    return from_dict(_nested(values, path), str(path))


def _check_readable_by_nodes(values: dict[Any, Any], path: Path, prefix: str = "") -> None:
    """Raises InputError for what nodes would refuse in a parameter file that commands can read."""
    for key, value in values.items():
        if isinstance(value, dict):
            if not value:
                raise InputError(f"{path}: nothing stands below '{prefix}{key}', which nodes refuse; remove it")
            _check_readable_by_nodes(value, path, f"{prefix}{key}.")
        elif isinstance(value, list) and {type(own) for own in value} == {int, float}:
            raise InputError(
                f"{path}: '{prefix}{key}' mixes whole numbers and decimals, which nodes refuse; write all with a point,"
                " as 1.0"
            )


def _nested(values: dict[Any, Any], path: Path) -> dict[Any, Any]:
    """The values, each key ``group.name`` moved into its group, as ROS 2 reads it. Raises InputError for a clash."""
    dotted = {key: value for key, value in values.items() if isinstance(key, str) and "." in key}
    nested = {key: value for key, value in values.items() if key not in dotted}
    for key, value in dotted.items():
        group, _, name = key.partition(".")
        section = nested.get(group)
        if section is not None and (not isinstance(section, dict) or name in section):
            raise InputError(f"{path}: '{key[:80]}' is given again below '{group[:80]}'; leave one of the two out")
        nested[group] = {**(section or {}), name: value}
    return nested


def _is_of_nodes(key: Any, value: Any, levels: int = DEEPEST) -> bool:
    """Whether what stands below a key has the form of a ROS 2 parameter file, addressed to nodes by name."""
    if key == "ros__parameters":
        return True
    return levels > 0 and isinstance(value, dict) and any(_is_of_nodes(*item, levels - 1) for item in value.items())


def _check_alone(values: dict[Any, Any], key: str, path: Path) -> None:
    """Raises InputError where something stands beside a level of a parameter file that nobody would read.

    Parameters of nodes that are not ours may stand beside ``/**``.
    """
    others = {str(other): value for other, value in values.items() if other != key}
    if key == "/**":
        others = {
            name: value
            for name, value in others.items()
            if OUR_NODE.search(name) or not (isinstance(value, dict) and set(value) == {"ros__parameters"})
        }
    beside = list(others)
    if beside:
        raise InputError(
            f"{path}: '{beside[0][:80]}' stands beside '{key}', where it has no effect; move the configuration's"
            f" parameters below that, {OTHERS_ELSEWHERE}"
        )
