"""Parameters of the hypothesis manager that may be set while it runs."""

from collections.abc import Callable, Mapping
from typing import Any

from rclpy.parameter import Parameter

from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.pipeline.session import CHANGEABLE, Session
from semantic_slam.ros.node.changes import Values, follow_changes
from semantic_slam.ros.node.parameters import changed, number
from semantic_slam.ros.node.pipeline_node import PipelineNode
from semantic_slam.ros.publishing.belief_publisher import BeliefPublisher
from semantic_slam.ros.rounds.ros_pool import RosPool


class RunChanges:
    """Checks values that are set, and passes on those that the belief depends on to the worker's thread."""

    def __init__(
        self,
        node: PipelineNode,
        session: Callable[[], Session],
        change: Callable[[Values], None],
        pool: RosPool,
        publisher: BeliefPublisher,
    ) -> None:
        """``session``: the present one. ``change``: uses values of ``CHANGEABLE``; called on the worker's thread."""
        self._node, self._session, self._change = node, session, change
        self._pool = pool
        self._alone: Mapping[str, Callable[[Any], None]] = {
            "backend_timeout_s": self._wait_for_backends,
            "broadcast_odom": publisher.broadcast_odom,
        }
        follow_changes(node, (*CHANGEABLE, *self._alone), self._check, self._use)

    def changed(self, values: Values) -> Configuration:
        """The configuration of the present session with some values of ``CHANGEABLE``. Raises InputError."""
        return changed(self._session().configuration, values, f"parameters of {self._node.get_name()}")

    def state(self) -> None:
        """Have the node's parameters say what the session uses, after a restart; may be called on any thread."""
        configuration = self._session().configuration
        told = [Parameter(name, value=_value(configuration, name)) for name in CHANGEABLE]
        self._node.executor.create_task(self._node.set_parameters, told)

    def _check(self, values: Values) -> None:
        timeout = values.get("backend_timeout_s", self._pool.timeout_s)
        if number(self._node, "backend_timeout_s", timeout) <= 0.0:
            raise InputError(f"backend_timeout_s is {timeout}; give a positive number of seconds")
        self._session().check_change(self.changed(_of_run(values)))

    def _use(self, values: Values) -> None:
        for name, use in self._alone.items():
            if name in values:
                use(values[name])
        if _of_run(values):
            self._node.worker.submit(self._change, _of_run(values))

    def _wait_for_backends(self, timeout_s: float) -> None:
        self._pool.timeout_s = float(timeout_s)


def _of_run(values: Values) -> dict[str, Any]:
    return {name: value for name, value in values.items() if name in CHANGEABLE}


def _value(configuration: Configuration, name: str) -> Any:
    section, _, field = name.partition(".")
    return getattr(getattr(configuration, section), field)
