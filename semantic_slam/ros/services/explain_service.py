"""Service ``~/explain`` of the hypothesis manager: a run is inferred again, in a process of its own.

Questions are answered one after the other; the executor, which hands messages to the worker, waits for none of them.
"""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from semantic_slam_msgs.srv import Explain

from semantic_slam.errors import InputError
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.messages.codec import encode
from semantic_slam.pipeline.journal.kept_run import KeptRun
from semantic_slam.ros.services.answering import newest, row_of


class ExplainService:
    """Answers for the newest belief that it was told of."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._told: tuple[HybridBelief, KeptRun] | None = None
        self._queue = ThreadPoolExecutor(1, "explain")
        self._process: subprocess.Popen[bytes] | None = None
        group = ReentrantCallbackGroup()  # that of all others would wait for the answer
        self._service = node.create_service(Explain, "~/explain", self._answer, callback_group=group)

    def begin(self) -> None:
        """Another run begins."""
        self._told = None

    def tell(self, kept: KeptRun, belief: HybridBelief) -> None:
        """The run, and the belief after the newest of its keyframes."""
        self._told = belief, kept

    def close(self) -> None:
        """Give up what is being asked."""
        self._queue.shutdown(wait=False, cancel_futures=True)
        if self._process is not None:
            self._process.kill()

    async def _answer(self, request: Any, response: Any) -> Any:
        try:
            belief, kept = self._asked(int(request.object_id))
        except InputError as fault:
            response.fault = str(fault)
            return response
        response.keyframe = belief.keyframe
        done = Future(executor=self._node.executor)
        done.add_done_callback(lambda _: None)  # a task, with which the executor wakes up
        self._queue.submit(self._explain, belief, kept, int(request.object_id)).add_done_callback(
            lambda told: done.set_result(("the node ends", "") if told.cancelled() else told.result())
        )
        response.fault, response.explanation = await done
        return response

    def _asked(self, object_id: int) -> tuple[HybridBelief, KeptRun]:
        """The newest belief and its run. Raises InputError."""
        told = self._told
        belief = newest(told[0] if told is not None else None)
        row_of(belief, object_id)
        assert told is not None  # there is a belief
        if told[1].fault:
            raise InputError(told[1].fault)
        return told

    def _explain(self, belief: HybridBelief, kept: KeptRun, object_id: int) -> tuple[str, str]:
        """Fault and explanation, on the thread of the queue."""
        numbers = os.getpid(), kept.descriptor, kept.length, object_id
        try:
            with subprocess.Popen(
                [sys.executable, "-m", "semantic_slam.ros.services.explain_process", *map(str, numbers)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                pass_fds=(kept.descriptor,),
            ) as self._process:
                answer, complaint = self._process.communicate(encode(belief))
        except OSError as fault:
            return f"no process can be started that explains it ({fault.strerror}); make room and ask again", ""
        if not self._process.returncode:
            return "", answer.decode()
        lines = complaint.decode("utf-8", "replace").splitlines() or [f"exit code {self._process.returncode}"]
        return lines[-1], ""
