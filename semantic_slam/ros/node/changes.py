"""Parameters that may be set while a node runs; all others are read-only.

A change is checked on the executor's thread and refused, with the reason, before anything is set.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from semantic_slam.errors import InputError

Values = Mapping[str, Any]
"""New values by the parameters' names."""


def follow_changes(
    node: Node, names: Sequence[str], check: Callable[[Values], None], use: Callable[[Values], None]
) -> None:
    """Let the parameters ``names`` be set while the node runs.

    ``check`` raises InputError if values cannot be used; ``use`` is called with values that were set. Both are called
    on the executor's thread.
    """

    def is_allowed(parameters: Sequence[Parameter]) -> SetParametersResult:
        try:
            check(_values(parameters, names))
        except InputError as fault:
            return SetParametersResult(successful=False, reason=str(fault))
        return SetParametersResult(successful=True)

    def is_set(parameters: Sequence[Parameter]) -> None:
        values = _values(parameters, names)
        if values:
            use(values)

    node.add_on_set_parameters_callback(is_allowed)
    node.add_post_set_parameters_callback(is_set)


def _values(parameters: Sequence[Parameter], names: Sequence[str]) -> dict[str, Any]:
    return {parameter.name: parameter.value for parameter in parameters if parameter.name in names}
