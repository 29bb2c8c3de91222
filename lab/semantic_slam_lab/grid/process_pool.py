"""Backends in processes of their own, spoken to over pipes: what several cores are worth, exchange included."""

import multiprocessing
import pickle
import time
from collections.abc import Mapping
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any

from semantic_slam.inference.backend import Backend
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import Candidates, Commit, Components, RunConfiguration
from semantic_slam.inference.smoothing.component import Component


class ProcessPool:
    """``number`` backends that work at the same time; a context manager.

    ``seconds`` counts the time in both rounds, ``busy_seconds`` the CPU time of the backend that took longest in each.
    Once ``seconds`` passes ``limit_s``, TimeoutError is raised; on any error the backends are ended where they are.
    """

    def __init__(self, number: int, limit_s: float | None = None):
        self.backend_ids = tuple(range(number))
        self.limit_s = limit_s
        self.seconds = self.busy_seconds = 0.0
        context = multiprocessing.get_context("spawn")
        pipes = [context.Pipe() for _ in self.backend_ids]
        self._pipes = [here for here, _ in pipes]
        self._processes = [
            context.Process(target=_serve, args=(n, there), daemon=True)
            for n, (_, there) in zip(self.backend_ids, pipes, strict=True)
        ]
        for process in self._processes:
            process.start()

    def __enter__(self) -> "ProcessPool":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        for pipe, process in zip(self._pipes, self._processes, strict=True):
            if kind is None:
                pipe.send_bytes(pickle.dumps(None))
            else:
                process.terminate()
            process.join()

    def start(self, run: RunConfiguration) -> None:
        """Begin a run."""
        self._ask("start", run)

    def expand(self, keyframe: Keyframe) -> list[Candidates]:
        """Round one: the candidates of every live hypothesis."""
        return self._ask("expand", keyframe)

    def commit(self, commit: Commit) -> list[Components]:
        """Round two: the survivors forked, updated and reported."""
        return [answer for answer in self._ask("commit", commit) if answer is not None]

    def offer(self, components: Mapping[int, Component]) -> None:
        """Nothing: backends of other processes rebuild what they are to hold."""

    def resident_mb(self) -> float:
        """Memory of all backends at its peak."""
        return float(sum(self._ask("resident", None)))

    def _ask(self, question: str, argument: Any) -> list[Any]:
        start = time.perf_counter()
        content = pickle.dumps((question, argument))
        for pipe in self._pipes:
            pipe.send_bytes(content)
        answers, busy = zip(*(self._answer(pipe, start) for pipe in self._pipes), strict=True)
        self.seconds += time.perf_counter() - start
        self.busy_seconds += max(busy)
        for answer in answers:
            if isinstance(answer, Exception):
                raise answer
        return list(answers)

    def _answer(self, pipe: Connection, start: float) -> tuple[Any, float]:
        """What a backend says, and the CPU time it took."""
        left = None
        if self.limit_s is not None:
            left = max(0.0, self.limit_s - self.seconds - (time.perf_counter() - start))
        if not pipe.poll(left):
            raise TimeoutError(f"the backends have worked for more than {self.limit_s} s")
        answer, busy = pickle.loads(pipe.recv_bytes())
        return answer, busy


def _serve(number: int, pipe: Connection) -> None:
    backend = Backend(number)
    while (question := pickle.loads(pipe.recv_bytes())) is not None:
        name, argument = question
        start = time.process_time()
        try:
            answer = _peak_mb() if name == "resident" else getattr(backend, name)(argument)
        except Exception as fault:  # handed to the manager's process, which raises it
            answer = fault
        pipe.send_bytes(pickle.dumps((answer, time.process_time() - start)))


def _peak_mb() -> float:
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
