"""Backends in this process: offline use of the manager."""

from typing import Any

from semantic_slam.inference.backend import Backend
from semantic_slam.inference.problem import Problem
from semantic_slam.inference.protocol import Candidates, Commit, Components


class InProcessPool:
    """``number`` backends that are called one after the other."""

    def __init__(self, number: int, problem: Problem, run_id: str):
        self.backend_ids = tuple(range(number))
        self._backends = [Backend(n, problem, run_id, owner_of_root=n == 0) for n in self.backend_ids]

    def expand(self, keyframe: Any) -> list[Candidates]:
        """Round one."""
        return [backend.expand(keyframe) for backend in self._backends]

    def commit(self, commit: Commit) -> list[Components]:
        """Round two."""
        answers = [backend.commit(commit) for backend in self._backends]
        return [answer for answer in answers if answer is not None]
