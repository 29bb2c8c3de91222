"""Maps the fields of :class:`Configuration` to ROS parameters and back."""

import dataclasses
import math
from collections.abc import Collection, Iterator, Mapping
from operator import attrgetter
from typing import Any, TypeVar, cast

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterValueException
from rclpy.node import Node

from semantic_slam.configuration import Configuration, choices_of, from_dict, to_dict
from semantic_slam.errors import InputError, one_line

T = TypeVar("T")
SETTINGS_OF_ROS = frozenset({"use_sim_time", "start_type_description_service"})
"""Parameters that rclpy reads itself."""


def leaves(cls: type = Configuration, prefix: str = "") -> Iterator[tuple[str, "dataclasses.Field[Any]", Any]]:
    """Every parameter as (dotted name, dataclass field, default)."""
    for item in dataclasses.fields(cls):
        default = _default(item)
        if dataclasses.is_dataclass(default):
            yield from leaves(type(default), f"{prefix}{item.name}.")
        else:
            yield prefix + item.name, item, default


def _default(item: "dataclasses.Field[Any]") -> Any:
    return item.default if item.default_factory is dataclasses.MISSING else item.default_factory()


def changed_parameters(configuration: Configuration) -> dict[str, Any]:
    """Dotted names and values of the parameters that differ from their defaults."""
    values = {name: attrgetter(name)(configuration) for name, _, _ in leaves()}
    return {
        name: list(values[name]) if isinstance(default, tuple) else values[name]
        for name, _, default in leaves()
        if values[name] != default
    }


def declare_configuration(node: Node, changeable: Collection[str] = ()) -> Configuration:
    """Declare every parameter and return the effective configuration. Raises InputError.

    ``changeable``: dotted names of those that may be set later; the others are read-only.
    """
    values: dict[str, Any] = {}
    given = node._parameter_overrides  # rclpy offers no public view of parameters given but not declared
    for name, item, default in leaves():
        former = given.get(_former(name, item))
        start = default if former is None else former.value
        value = _declared(node, name, start, descriptor(item, default, read_only=name not in changeable))
        if value is not None:
            _insert(values, name.split("."), value)
        elif default != ():  # what is empty in a YAML file has no type and arrives as "not set"
            raise InputError(_empty(node, name))
    return from_dict(values, f"parameters of {node.get_name()}")


def configuration_of(parameters: Mapping[str, Any], origin: str) -> Configuration:
    """Configuration from values by dotted names; the others keep their defaults. Raises InputError."""
    values: dict[str, Any] = {}
    for name, _, _ in leaves():
        if name in parameters:
            _insert(values, name.split("."), parameters[name])
    return from_dict(values, origin)


def changed(configuration: Configuration, values: Mapping[str, Any], origin: str) -> Configuration:
    """The configuration with some values, by dotted names. Raises InputError, with ``origin``, for invalid ones."""
    nested = to_dict(configuration)
    for name, value in values.items():
        _insert(nested, name.split("."), value)
    return from_dict(nested, origin)


def declare_fixed(node: Node, name: str, default: T) -> T:
    """Declare a read-only parameter, read once at start, and return its value. Raises InputError.

    For a float parameter an integer such as ``1`` is accepted, too.
    """
    return _declared_alone(node, name, default, "read when the node starts", read_only=True)


def declare_changeable(node: Node, name: str, default: T) -> T:
    """Declare a parameter that may be set later, and return its first value; otherwise like :func:`declare_fixed`."""
    return _declared_alone(node, name, default, "may be set while the node runs", read_only=False)


def _declared_alone(node: Node, name: str, default: T, text: str, *, read_only: bool) -> T:
    is_number = isinstance(default, float)
    told = ParameterDescriptor(description=text, read_only=read_only, dynamic_typing=is_number)
    value = node.declare_parameter(name, default, told).value
    if value is None:
        raise InputError(_empty(node, name))
    return cast(T, number(node, name, value) if is_number else value)


def _empty(node: Node, name: str) -> str:
    return f"parameters of {node.get_name()}: '{name}' is empty; give a value, or remove it"


def number(node: Node, name: str, value: Any) -> float:
    """The value of a float parameter. Raises InputError if it is none."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"parameters of {node.get_name()}: {name} is {value!r}; give a number")
    return float(value)


def refuse_undeclared(node: Node) -> None:
    """Raise InputError for parameters given but not declared, such as a mistyped ``pruning.ration``.

    Otherwise the default would silently stay in place. Every node accepts all names of the configuration, because a
    parameter file for ``/**`` addresses all nodes.
    """
    known = {name for name, _, _ in leaves()} | {_former(name, item) for name, item, _ in leaves()} | SETTINGS_OF_ROS
    groups = {name.rpartition(".")[0] for name, _, _ in leaves()}
    for name in node._parameter_overrides:
        if name in groups:
            raise InputError(
                f"parameters of {node.get_name()}: '{name}' must be a mapping; see config/default.yaml, or remove it"
            )
        if not (name in known or node.has_parameter(name) or name.startswith("qos_overrides.")):
            raise InputError(
                f"parameters of {node.get_name()}: unknown parameter '{name}'; see --help and config/default.yaml"
            )


def descriptor(item: "dataclasses.Field[Any]", default: Any, *, read_only: bool = True) -> ParameterDescriptor:
    """Parameter descriptor of a field: description and limits; typing is dynamic, so that ``1`` may mean ``1.0``."""
    limits = item.metadata
    result = ParameterDescriptor(description=limits["description"], read_only=read_only, dynamic_typing=True)
    if choices_of(item):
        result.additional_constraints = "one of " + ", ".join(choices_of(item))
    if "minimum" in limits or "maximum" in limits:
        low, high = limits.get("minimum", -math.inf), limits.get("maximum", math.inf)
        if isinstance(default, float):
            result.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high))]
        else:
            top = 2**63 - 1
            result.integer_range = [IntegerRange(from_value=int(low), to_value=top if high == math.inf else int(high))]
    return result


def _declared(node: Node, name: str, start: Any, told: ParameterDescriptor) -> Any:
    is_list = isinstance(start, tuple | list)
    try:
        value = node.declare_parameter(name, list(start) if is_list else start, told).value
    except InvalidParameterValueException as fault:
        raise InputError(f"parameters of {node.get_name()}: {one_line(fault)}") from None
    return list(value) if is_list and not isinstance(value, str | int | float | None) else value


def _former(name: str, item: "dataclasses.Field[Any]") -> str | None:
    """Dotted former name of a parameter; None if it was never renamed."""
    old = item.metadata.get("formerly")
    return old and ".".join([*name.split(".")[:-1], old])


def _insert(values: dict[str, Any], path: list[str], value: Any) -> None:
    for key in path[:-1]:
        values = values.setdefault(key, {})
    values[path[-1]] = value
