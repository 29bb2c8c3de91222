"""Runs long service requests on a background thread, so that the executor is not blocked."""

from concurrent.futures import Future as Answering
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future

from semantic_slam.ros.services.answering import Handler


class InBackground:
    """A thread that answers service requests one after the other."""

    def __init__(self, node: Node, name: str) -> None:
        self._node = node
        self._queue = ThreadPoolExecutor(1, name)

    def create_service(self, kind: type, name: str, handler: Handler) -> Any:
        """Create a service that ``handler`` answers on the thread; its response type needs a field ``fault``."""

        async def answer(request: Any, response: Any) -> Any:
            told = Future(executor=self._node.executor)
            told.add_done_callback(lambda _: None)  # scheduled as a task, which wakes the executor
            answering = self._queue.submit(handler, request, response)
            answering.add_done_callback(lambda done: _tell(done, told, response))
            return await told

        group = ReentrantCallbackGroup()  # the default group would block until the answer is there
        return self._node.create_service(kind, name, answer, callback_group=group)

    def close(self) -> None:
        """Cancel the requests that are still queued."""
        self._queue.shutdown(wait=False, cancel_futures=True)


def _tell(done: "Answering[Any]", told: Future, response: Any) -> None:
    """Pass the result to the awaiting service callback; an exception there ends the node."""
    if done.cancelled():
        response.fault = "the node ends"
        told.set_result(response)
    elif (fault := done.exception()) is not None:
        told.set_exception(fault)
    else:
        told.set_result(done.result())
