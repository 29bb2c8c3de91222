"""Launch actions of nodes, for the launch files; only these import it, as ``launch`` is not everywhere."""

import signal
import time
from collections.abc import Callable, Sequence
from typing import Any

from launch.actions import EmitEvent, LogInfo, Shutdown, TimerAction
from launch.events import matches_action
from launch.events.process import SignalProcess
from launch_ros.actions import Node

from semantic_slam.errors import InputError
from semantic_slam.ros.launching.node_set import NodeSpec
from semantic_slam.ros.launching.supervisor import Supervisor


class Nodes:
    """Launch actions of the nodes, with restarts by a :class:`Supervisor` when one of them ends."""

    def __init__(
        self, specs: Sequence[NodeSpec], namespace: str, *, last: str = "", remappings: Sequence[tuple[str, str]] = ()
    ) -> None:
        """``last``: see :class:`Supervisor`; ``remappings``: other names of topics, (FROM, TO), for all nodes."""
        self._specs = specs
        self._supervisor = Supervisor(specs, last)
        self._namespace, self._remappings = namespace, list(remappings)
        self._actions: dict[str, Any] = {}

    def actions(self) -> list[Any]:
        """Launch actions that start all nodes."""
        return [self._action(spec) for spec in self._specs]

    def _action(self, spec: NodeSpec) -> Any:
        self._actions[spec.name] = Node(
            package="semantic_slam",
            executable=spec.executable,
            name=spec.name,
            namespace=self._namespace,
            parameters=[spec.parameters],
            remappings=self._remappings,
            output="screen",
            emulate_tty=True,
            on_exit=self._end_of(spec.name),
        )
        return self._actions[spec.name]

    def _end_of(self, name: str) -> Callable[[Any, Any], list[Any]]:
        def on_exit(event: Any, context: Any) -> list[Any]:
            if context.is_shutdown:
                return []
            verdict = self._supervisor.ended(name, event.returncode, time.monotonic())
            if verdict.ends_run:
                return [Shutdown(reason=verdict.text)]
            actions = [LogInfo(msg=verdict.text)] if verdict.text else []
            actions += [self._kill(other) for other in verdict.kill if self._is_up(other)]
            if verdict.again is not None:
                actions.append(TimerAction(period=verdict.after_s, actions=[self._action(verdict.again)]))
            return actions

        return on_exit

    def _is_up(self, name: str) -> bool:
        """Whether a node is running; if not, it is already due for a restart, and the supervisor is told."""
        details = self._actions[name].process_details
        if details is None:
            self._supervisor.is_down(name)
        return details is not None

    def _kill(self, name: str) -> Any:
        matcher = matches_action(self._actions[name])
        return EmitEvent(event=SignalProcess(signal_number=signal.SIGKILL, process_matcher=matcher))


def remappings_of(text: str) -> list[tuple[str, str]]:
    """Pairs (FROM, TO) of a text such as ``odom:=/my/odom image:=/camera/image``. Raises InputError."""
    pairs = []
    for word in text.split():
        source, separator, target = word.partition(":=")
        if not (separator and source and target):
            raise InputError(f"remap: '{word}' is not FROM:=TO; write for example odom:=/my/odom")
        pairs.append((source, target))
    return pairs
