"""Backends in processes of their own, whose time is taken: what several cores are worth, exchange included."""

import time
from pathlib import Path
from typing import Any

from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.processes.process_pool import ProcessPool
from semantic_slam.inference.processes.questions import Answer

PEAK = "VmHWM:"
"""Line of a process's status, as Linux tells it, with the most memory [kB] that it has had."""


class MeasuredPool(ProcessPool):
    """``number`` backends that work at the same time; a context manager.

    ``seconds`` counts the time in both rounds, ``busy_seconds`` the CPU time of the backend that took longest in each.
    Once ``seconds`` passes ``limit_s``, TimeoutError is raised; on any error the backends are ended where they are.
    """

    def __init__(self, number: int, limit_s: float | None = None):
        super().__init__(number)
        self.limit_s = limit_s
        self.seconds = self.busy_seconds = 0.0
        self._asked_s = 0.0

    def begin(self, keyframe: Keyframe) -> None:
        """Nothing, so that a round is measured from when its answers are wanted."""

    def expand(self, keyframe: Keyframe) -> list[Any]:
        """Round one: the candidates of every live hypothesis."""
        self._ask("expand", keyframe)
        return self._collect()

    def resident_mb(self) -> float:
        """Memory of all backends at its peak [MB]."""
        return sum(_peak_kb(process.process_id) for process in self.processes) / 1024.0

    def _ask(self, name: str, argument: Any) -> None:
        self._asked_s = time.perf_counter()
        super()._ask(name, argument)

    def _answers(self) -> list[Answer]:
        answers = [process.receive(self._left_s()) for process in self.processes]
        self.seconds += time.perf_counter() - self._asked_s
        self.busy_seconds += max(answer.cpu_s for answer in answers)
        return answers

    def _left_s(self) -> float | None:
        if self.limit_s is None:
            return None
        return max(0.0, self.limit_s - self.seconds - (time.perf_counter() - self._asked_s))


def _peak_kb(process_id: int) -> float:
    lines = Path(f"/proc/{process_id}/status").read_text("utf-8").splitlines()
    return float(next(line.split()[1] for line in lines if line.startswith(PEAK)))
