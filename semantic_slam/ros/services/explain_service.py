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
from semantic_slam.ros.services.answering import answering, newest
from semantic_slam.ros.services.in_background import InBackground


class ExplainService:
    """Answers requests for the newest belief set by :meth:`tell`."""

    def __init__(self, node: Node) -> None:
        self._told: tuple[HybridBelief, KeptRun] | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._background = InBackground(node, "explain")
        self._service = self._background.create_service(Explain, "~/explain", answering(self._answer))

    def begin(self) -> None:
        """Start another run: forget the belief."""
        self._told = None

    def tell(self, kept: KeptRun, belief: HybridBelief) -> None:
        """Set the run and the belief after its newest keyframe."""
        self._told = belief, kept

    def close(self) -> None:
        """Cancel pending requests and kill the running process."""
        self._background.close()
        if self._process is not None:
            self._process.kill()

    def _answer(self, request: Any, response: Any) -> None:
        belief, kept = self._asked(int(request.object_id))
        response.keyframe = belief.keyframe
        response.explanation = self._explained(belief, kept, int(request.object_id))

    def _asked(self, object_id: int) -> tuple[HybridBelief, KeptRun]:
        """The newest belief and its run. Raises InputError."""
        told = self._told
        belief = newest(told[0] if told is not None else None)
        row_of(belief, object_id)
        assert told is not None  # there is a belief
        if told[1].fault:
            raise InputError(told[1].fault)
        return told

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
