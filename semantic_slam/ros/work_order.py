"""The order of a backend's work: announcement, then keyframe and commit in turn, whatever the order of arrival.

Each topic keeps its own order, different topics have none: a commit may arrive before the keyframe it belongs to, and
after a restart all of them arrive at once. What does not belong to the run, or cannot be, is counted and changes
nothing: a backend serves whoever announced a run, and another announcement silences nobody. Nothing here knows ROS.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from semantic_slam.errors import InputError, MessageError
from semantic_slam.inference.backend import Backend
from semantic_slam.inference.build import run_id_of
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import Candidates, Commit, Components, RunConfiguration
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message
from semantic_slam.messages.typestore import deserialize
from semantic_slam.ros.round_checks import fault_of_commit, fault_of_keyframe

Answer = Candidates | Components
MOST_RUNS = 2
"""Runs that a backend holds: that of its manager, and that of the one before it, or of whoever else announced one."""
MOST_WAITING = 5000
"""Messages of either round that wait for those before them; as many as a late reader is sent."""


@dataclass
class _Run:
    """One run, and how far it has come."""

    announced: RunConfiguration
    backend: Backend
    stamps_ns: list[int] = field(default_factory=list)  # of the keyframes expanded
    num_expanded: int = 0  # keyframes expanded
    num_committed: int = 0
    is_announced_again: bool = False


@dataclass
class WorkOrder:
    """Feeds the backends of announced runs and returns their answers; ``dropped`` counts what was not used, by reason.

    ``make_backend`` makes the backend of one run.
    """

    make_backend: Callable[[], Backend]
    dropped: Counter[str] = field(default_factory=Counter)
    _runs: dict[str, _Run] = field(default_factory=dict)
    _keyframes: dict[tuple[str, int], Keyframe] = field(default_factory=dict)
    _commits: dict[tuple[str, int], Commit] = field(default_factory=dict)

    def take(self, data: bytes, type_name: str) -> list[Answer]:
        """The answers to a message of the wire; one that cannot be used is counted."""
        try:
            message = deserialize(data, type_name)
            value = from_message(message)
            if isinstance(value, Keyframe):
                return self.keyframe(str(message.run_id), value)
            return self.start(value) if isinstance(value, RunConfiguration) else self.commit(value)
        except MessageError as fault:
            self.dropped[f"{type_name}: {fault.kind}"] += 1
            return []

    def start(self, run: RunConfiguration) -> list[Answer]:
        """A run is announced; a second announcement may come from a manager that was started anew.

        Raises MessageError where no run can be made of it.
        """
        known = self._runs.get(run.run_id)
        if known is not None:
            known.is_announced_again = True
            return []
        self._runs[run.run_id] = _Run(run, self._started(run))
        if len(self._runs) > MOST_RUNS:
            idle = [name for name, other in self._runs.items() if not other.num_expanded and name != run.run_id]
            del self._runs[idle[0] if idle else next(iter(self._runs))]
        return self._advance(run.run_id)

    def keyframe(self, run_id: str, keyframe: Keyframe) -> list[Answer]:
        """Round one. The newest keyframe is answered again; older ones are stale."""
        fault = fault_of_keyframe(keyframe)
        if fault:
            self.dropped[f"{topics.KEYFRAMES}: {fault}"] += 1
            return []
        run = self._runs.get(run_id)
        if run is not None and keyframe.index < run.num_expanded:
            if keyframe.index == 0 and run.is_announced_again:
                self._begin_anew(run)
            elif keyframe.index == run.num_expanded - 1 == run.num_committed and keyframe.index > 0:
                return [self._expanded(run, keyframe)]
            else:
                self.dropped[f"{topics.KEYFRAMES}: of an earlier keyframe"] += 1
                return []
        self._keep(self._keyframes, (run_id, keyframe.index), keyframe, topics.KEYFRAMES)
        return self._advance(run_id)

    def commit(self, commit: Commit) -> list[Answer]:
        """Round two. One that was already followed is idempotent in the backend, and ignored there when stale."""
        run = self._runs.get(commit.run_id)
        if run is not None and commit.keyframe < run.num_committed:
            return self._followed(run, commit)
        self._keep(self._commits, (commit.run_id, commit.keyframe), commit, topics.COMMITS)
        return self._advance(commit.run_id)

    def _started(self, run: RunConfiguration) -> Backend:
        told = (run.configuration, run.map_prior, run.initial_pose, run.initial_covariance, run.class_names)
        if run.run_id != run_id_of(*told):
            raise MessageError("run configuration: its id is not that of its contents", "id of another run")
        backend = self.make_backend()
        try:
            backend.start(run)
        except (InputError, ValueError, RecursionError) as fault:
            text = " ".join(str(fault).split())[:200]
            raise MessageError(
                f"run configuration: no run can be made of it ({text})", "no run can be made of it"
            ) from None
        return backend

    def _begin_anew(self, run: _Run) -> None:
        """A manager that was started anew goes through its keyframes again."""
        run.backend.start(run.announced)
        run.num_expanded = run.num_committed = 0
        run.is_announced_again, run.stamps_ns = False, []

    def _keep(self, waiting: dict[tuple[str, int], Any], key: tuple[str, int], value: Any, topic: str) -> None:
        waiting[key] = value
        if len(waiting) > MOST_WAITING:
            del waiting[next(iter(waiting))]
            self.dropped[f"{topic}: of no run that goes on"] += 1

    def _advance(self, run_id: str) -> list[Answer]:
        """Do all that can be done by now, in turn."""
        answers: list[Answer] = []
        run = self._runs.get(run_id)
        while run is not None:
            if run.num_committed == run.num_expanded:
                keyframe = self._keyframes.pop((run_id, run.num_expanded), None)
                if keyframe is None:
                    break
                answers.append(self._expanded(run, keyframe))
                run.num_expanded += 1
            else:
                commit = self._commits.pop((run_id, run.num_committed), None)
                if commit is None:
                    break
                followed = self._followed(run, commit)
                answers += followed
                run.num_committed += bool(followed)
        return answers

    @staticmethod
    def _expanded(run: _Run, keyframe: Keyframe) -> Candidates:
        del run.stamps_ns[keyframe.index :]
        run.stamps_ns.append(keyframe.stamp_ns)
        return run.backend.expand(keyframe)

    def _followed(self, run: _Run, commit: Commit) -> list[Answer]:
        """The answer to a commit; none to one that contradicts itself, which is counted, or to a stale one."""
        fault = fault_of_commit(commit, run.stamps_ns[commit.keyframe])
        if fault:
            self.dropped[f"{topics.COMMITS}: {fault}"] += 1
            return []
        answer = run.backend.commit(commit)
        return [answer] if answer is not None else []
