"""Services ``~/reset``, ``~/pause`` and ``~/load_map`` of the hypothesis manager.

What they ask for is done on the worker's thread, after all that was received before; they answer when it is done.
"""

from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any, Protocol

from rclpy.task import Future
from semantic_slam_msgs.srv import LoadMap
from std_srvs.srv import SetBool, Trigger

from semantic_slam.errors import InputError
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.ros.pipeline_node import PipelineNode


class Sessions(Protocol):
    """What the services ask of a manager, on its worker's thread."""

    def reset(self) -> str:
        """End the run; another one begins at keyframe 0. Says what has ended."""

    def pause(self, paused: bool) -> str:
        """Make no keyframes, or make them again. Says so."""

    def load(self, prior: MapPrior) -> None:
        """End the run; another one begins on this map. Raises InputError where none can."""


class SessionServices:
    """The three services; ``read`` reads the map of a file."""

    def __init__(self, node: PipelineNode, sessions: Sessions, read: Callable[[Path], MapPrior]) -> None:
        self._node, self._sessions, self._read = node, sessions, read
        self._services = [
            node.create_service(Trigger, "~/reset", self._done(self._reset)),
            node.create_service(SetBool, "~/pause", self._done(self._pause)),
            node.create_service(LoadMap, "~/load_map", self._done(self._load)),
        ]

    def _done(self, act: Callable[[Any, Any], None]) -> Callable[[Any, Any], Coroutine[Any, Any, Any]]:
        """A handler that has ``act(request, response)`` called by the worker, and waits without blocking the node."""

        async def answer(request: Any, response: Any) -> Any:
            executor = self._node.executor
            done = Future(executor=executor)

            def work(_: None) -> None:
                act(request, response)
                done.set_result(response)
                executor.wake()

            self._node.worker.submit(work, None)
            return await done

        return answer

    def _reset(self, _: Any, response: Any) -> None:
        response.success, response.message = True, self._sessions.reset()

    def _pause(self, request: Any, response: Any) -> None:
        response.success, response.message = True, self._sessions.pause(request.data)

    def _load(self, request: Any, response: Any) -> None:
        try:
            prior = self._read(Path(request.path))
            self._sessions.load(prior)
        except InputError as fault:
            response.fault = str(fault)
            return
        response.objects = len(prior.objects)
        response.map_id = getattr(prior, "map_id", "")
