"""Services ``~/reset``, ``~/pause`` and ``~/load_map`` of the hypothesis manager.

They answer at once; ``~/load_map`` after the map was read and checked. The worker executes the request after all
messages received before. A handler that waited for that would deadlock: it would block the executor, which receives the
backend answers that the worker waits for.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from semantic_slam_msgs.srv import LoadMap
from std_srvs.srv import SetBool, Trigger

from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.ros.node.pipeline_node import PipelineNode
from semantic_slam.ros.services.answering import answering
from semantic_slam.ros.services.in_background import InBackground


class Sessions(Protocol):
    """Interface of the manager that the services use; all but ``check`` are called on its worker thread."""

    def reset(self) -> None:
        """End the run and start another one at keyframe 0."""

    def pause(self, paused: bool) -> None:
        """Stop or resume making keyframes."""

    def check(self, prior: MapPrior) -> None:
        """Check that a run can start on this map. Raises InputError."""

    def load(self, prior: MapPrior) -> None:
        """End the run and start another one on this map."""


class SessionServices:
    """The three session services; ``read`` reads a map file."""

    def __init__(
        self, node: PipelineNode, background: InBackground, sessions: Sessions, read: Callable[[Path], MapPrior]
    ) -> None:
        self._worker, self._sessions, self._read = node.worker, sessions, read
        self._services = [
            node.create_service(Trigger, "~/reset", self._reset),
            node.create_service(SetBool, "~/pause", self._pause),
            background.create_service(LoadMap, "~/load_map", answering(self._load)),
        ]

    def _reset(self, _: Any, response: Any) -> Any:
        self._worker.submit(lambda _: self._sessions.reset(), None)
        response.success, response.message = True, "the run ends; another one begins at keyframe 0"
        return response

    def _pause(self, request: Any, response: Any) -> Any:
        self._worker.submit(self._sessions.pause, bool(request.data))
        response.success, response.message = True, "no keyframes are made" if request.data else "keyframes are made"
        return response

    def _load(self, request: Any, response: Any) -> None:
        prior = self._read(Path(request.path))
        self._sessions.check(prior)
        self._worker.submit(self._sessions.load, prior)
        response.objects, response.map_id = len(prior.objects), prior.map_id
