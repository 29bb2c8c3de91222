"""Configurations from YAML files, plain or in the form of ROS 2 parameter files."""

import re
from pathlib import Path
from typing import Any

from semantic_slam.configuration.configuration import Configuration
from semantic_slam.configuration.dictionary import from_dict
from semantic_slam.configuration.parameter_file import ParameterFileLoader
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
    text = read_text(path, REMEDY)
    values = parse_yaml(text, str(path), REMEDY) or {}
    if not isinstance(values, dict):
        raise InputError(f"{path}: a mapping is expected; {REMEDY}")
    if "/**" in values:
        return _of_parameter_file(parse_yaml(text, str(path), REMEDY, ParameterFileLoader), path)
    if addressed := [str(key) for key, value in values.items() if _is_of_nodes(key, value)]:
        raise InputError(
            f"{path}: its parameters stand below '{addressed[0][:80]}', for nodes of that name alone; commands have no"
            f" such name: put the configuration's below '/**:' and 'ros__parameters:', {OTHERS_ELSEWHERE}"
        )
    return from_dict(_nested(values, path), str(path))


def _of_parameter_file(document: dict[str, Any], path: Path) -> Configuration:
    """Configuration of a ROS 2 parameter file; raises InputError also for what nodes refuse in one, or misread."""
    _check_parsed_by_nodes(document, path)
    values: Any = document
    for key in ("/**", "ros__parameters"):
        _check_alone(values, key, path)
        values = values.get(key, {})
        if not isinstance(values, dict):
            raise InputError(f"{path}: '{key}' must be a mapping; {REMEDY}")
    values = _nested(values, path)
    _check_groups(values, path)
    configuration = from_dict(values, str(path))
    _check_lists(values, Configuration(), path)
    return configuration


def _check_parsed_by_nodes(values: dict[str, Any], path: Path, prefix: str = "") -> None:
    """Raises InputError for what ends a node while it parses the file, whichever node it is meant for."""
    for key, value in values.items():
        name = f"{path}: '{prefix}{key[:80]}'"
        if isinstance(value, dict):
            _check_parsed_by_nodes(value, path, "" if key in ("/**", "ros__parameters") else f"{prefix}{key}.")
        elif value is None or (isinstance(value, list) and None in value):
            raise InputError(f"{name} lacks a value, which nodes refuse; give one, or remove it")
        elif isinstance(value, list) and len(kinds := {type(own) for own in value}) > 1 and not kinds & {list, dict}:
            if kinds == {int, float}:
                raise InputError(
                    f"{name} mixes whole numbers and decimals, which nodes refuse; write all with a point, as 1.0"
                )
            raise InputError(f"{name} mixes names, numbers and yes or no, which nodes refuse; write names in quotes")


def _check_groups(values: dict[str, Any], path: Path, prefix: str = "") -> None:
    """Raises InputError for a group with nothing below it."""
    for key, value in values.items():
        if isinstance(value, dict):
            if not value:
                raise InputError(f"{path}: nothing stands below '{prefix}{key}', which nodes refuse; remove it")
            _check_groups(value, path, f"{prefix}{key}.")


def _check_lists(values: dict[str, Any], default: Any, path: Path, prefix: str = "") -> None:
    """Raises InputError for an empty list whose default is another one: it has no type, and does not reach nodes."""
    for key, value in values.items():
        usual = getattr(default, key, ())
        if isinstance(value, dict):
            _check_lists(value, usual, path, f"{prefix}{key}.")
        elif value == [] and usual != ():
            raise InputError(f"{path}: '{prefix}{key}' is empty, which nodes refuse; give a value, or remove it")


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
