"""YAML of ROS 2 parameter files as nodes read it: by the rules of rcl, which differ from those of other readers."""

import re
from typing import Any

import yaml

STRING = "tag:yaml.org,2002:str"
TRUE = frozenset(["y", "Y", "yes", "Yes", "YES", "true", "True", "TRUE", "on", "On", "ON"])
FALSE = frozenset(["n", "N", "no", "No", "NO", "false", "False", "FALSE", "off", "Off", "OFF"])
WHOLE = re.compile(r"[-+]?(0[xX][0-9a-fA-F]+|0[0-7]*|[1-9][0-9]*)")
DECIMAL = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")
HEXADECIMAL = re.compile(r"[-+]?0[xX][0-9a-fA-F]+\.?[0-9a-fA-F]*([pP][-+]?[0-9]+)?")
SPECIAL = re.compile(r"[-+]?\.?(inf|infinity|nan)", re.IGNORECASE)
LARGEST_WHOLE = 2**63


class ParameterFileLoader(yaml.SafeLoader):  # type: ignore[misc]  # yaml is not followed by mypy
    """Loader whose values are those of nodes; None stands for a value that is missing, which nodes refuse.

    Names of keys are texts. Dates, ``null``, ``1_000`` and ``1:30`` are texts, ``y`` is true, ``09`` is 9.0.
    """

    def resolve(self, kind: Any, value: Any, implicit: Any) -> Any:
        """No tag for scalars that state none, so that ``!!str y`` can be told from ``y``."""
        return "" if kind is yaml.ScalarNode else super().resolve(kind, value, implicit)

    def construct_document(self, node: yaml.Node) -> Any:
        return _value(node)


def _value(node: yaml.Node) -> Any:
    if isinstance(node, yaml.MappingNode):
        return {_name(key): _value(value) for key, value in node.value}
    if isinstance(node, yaml.SequenceNode):
        return [_value(item) for item in node.value]
    if node.tag == STRING or node.style in ("'", '"'):
        return node.value
    return _scalar(node.value)


def _name(key: yaml.Node) -> str:
    """Name that a key gives; raises YAMLError where it is a list or a mapping."""
    if not isinstance(key, yaml.ScalarNode):
        raise yaml.YAMLError(f"a list or a mapping is the name of a parameter in line {key.start_mark.line + 1}")
    return str(key.value)


def _scalar(text: str) -> bool | int | float | str | None:
    """Value of a text without quotes."""
    if text in TRUE or text in FALSE:
        return text in TRUE
    if WHOLE.fullmatch(text):
        digits = text.lstrip("+-")
        whole = int(text, 8 if digits.isdigit() and digits.startswith("0") else 0)
        if -LARGEST_WHOLE <= whole < LARGEST_WHOLE:
            return whole
    if DECIMAL.fullmatch(text):
        return float(text)
    if HEXADECIMAL.fullmatch(text):
        return float.fromhex(text)
    if SPECIAL.fullmatch(text):
        return float(text.replace(".", ""))
    return text or None
