"""Service ``~/explain`` of the hypothesis manager, which repeats the run's inference in a separate process.

Requests are answered one after the other on a background thread, so that the executor is not blocked.
"""

import os
import subprocess
import sys
from typing import Any

from rclpy.node import Node
from semantic_slam_msgs.srv import Explain

from semantic_slam.answers.rows import row_of
from semantic_slam.errors import InputError
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.messages.codec import encode
from semantic_slam.pipeline.journal.kept_run import KeptRun
from semantic_slam.ros.services.answering import answering
from semantic_slam.ros.services.belief_service import BeliefService
from semantic_slam.ros.services.in_background import InBackground


class ExplainService(BeliefService):
    """Explains the objects of the newest belief."""

    def __init__(self, node: Node) -> None:
        super().__init__()
        self._process: subprocess.Popen[bytes] | None = None
        self._background = InBackground(node, "explain")
        self._service = self._background.create_service(Explain, "~/explain", answering(self._answer))

    def close(self) -> None:
        """Cancel pending requests and kill the running process."""
        self._background.close()
        if self._process is not None:
            self._process.kill()

    def _answer(self, request: Any, response: Any) -> None:
        newest, object_id = self.newest(), int(request.object_id)
        row_of(newest.belief, object_id)
        if newest.kept_run.fault:
            raise InputError(newest.kept_run.fault)
        response.keyframe = newest.belief.keyframe
        response.explanation = self._explained(newest.belief, newest.kept_run, object_id)

    def _explained(self, belief: HybridBelief, kept: KeptRun, object_id: int) -> str:
        """Explanation of an object, computed by a separate process. Raises InputError."""
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
            raise InputError(
                f"no process can be started that explains it ({fault.strerror}); make room and ask again"
            ) from None
        if self._process.returncode:
            lines = complaint.decode("utf-8", "replace").splitlines()
            raise InputError(lines[-1] if lines else f"exit code {self._process.returncode}")
        return answer.decode()
