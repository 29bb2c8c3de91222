"""A pool of backends in processes of their own: they weigh and update hypotheses while this process looks back."""

from collections.abc import Mapping
from types import TracebackType
from typing import Any, Self

from semantic_slam.child_process import ChildProcess
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.processes.questions import Answer, Question
from semantic_slam.inference.protocol import Candidates, Commit, Components, RunConfiguration
from semantic_slam.inference.smoothing.component import Component

MODULE = "semantic_slam.inference.processes.backend_process"


class ProcessPool:
    """``number`` backends, each a process that ends with this context manager, or with this process.

    The belief is that of backends in this process, but for rounding on maps of many objects. Every round raises what a
    backend raised, and SemanticSlamError where a process has ended.
    """

    def __init__(self, number: int) -> None:
        self.backend_ids = tuple(range(number))
        self.processes = [ChildProcess(f"the process of backend {n}", MODULE, str(n)) for n in self.backend_ids]
        self._begun: int | None = None  # keyframe whose first round was begun and is not collected

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        for process in self.processes:
            process.end(at_once=kind is not None)

    def start(self, run: RunConfiguration) -> None:
        """Begin a run."""
        if self._begun is not None:  # and was not collected, as something went wrong
            self._begun = None
            self._answers()
        self._ask("start", run)
        self._collect()

    def begin(self, keyframe: Keyframe) -> None:
        """Ask for the candidates of every live hypothesis, which :meth:`expand` then collects."""
        self._ask("expand", keyframe)
        self._begun = keyframe.index

    def expand(self, keyframe: Keyframe) -> list[Candidates]:
        """Round one: the candidates of every live hypothesis."""
        if self._begun != keyframe.index:
            self.begin(keyframe)
        self._begun = None
        return self._collect()

    def commit(self, commit: Commit) -> list[Components]:
        """Round two: the survivors forked, updated and reported."""
        self._ask("commit", commit)
        return [answer for answer in self._collect() if answer is not None]

    def offer(self, components: Mapping[int, Component]) -> None:
        """Nothing: backends in other processes rebuild the components that they are to hold."""

    def _ask(self, name: str, argument: Any) -> None:
        for process in self.processes:
            process.send(Question(name, argument))

    def _collect(self) -> list[Any]:
        """What each backend returned, in the order of their ids."""
        answers = self._answers()
        for answer in answers:
            if answer.fault is not None:
                raise answer.fault
        return [answer.value for answer in answers]

    def _answers(self) -> list[Answer]:
        return [process.receive() for process in self.processes]
