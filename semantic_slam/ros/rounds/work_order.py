"""Orders a backend's work: run configuration, then keyframe and commit alternately, in whatever order they arrive.

Messages of one topic arrive in order, those of different topics in any order: a commit may arrive before the keyframe
it belongs to, and after a restart many arrive at once. A manager that requests a keyframe has finished the ones before,
so their commits are not waited for, and of several queued keyframes all but the newest are only stored, not expanded. A
backend that was started late or restarted requests the keyframes that it has missed. Invalid messages and those of
other runs are counted and otherwise ignored. Up to ``MOST_RUNS`` announced runs are served side by side, so a second
announcement does not displace the first. This module does not depend on ROS.
"""

from array import array
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count
from typing import Any

from semantic_slam.errors import InputError, MessageError, one_line
from semantic_slam.inference.backend import Backend
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import Candidates, Commit, Components, MissedKeyframes, RunConfiguration
from semantic_slam.inference.run_id import is_id_of_its_contents
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message
from semantic_slam.messages.typestore import deserialize
from semantic_slam.ros.rounds.round_checks import fault_of_commit, fault_of_keyframe
from semantic_slam.ros.rounds.waiting import Waiting

Answer = Candidates | Components | MissedKeyframes
MOST_RUNS = 2
"""Runs that a backend holds: its manager's, and the previous one or that of another manager."""
TOPICS = {topics.TYPES[topic]: topic for topic in (topics.RUN_CONFIGURATION, topics.KEYFRAMES, topics.COMMITS)}


@dataclass
class _Run:
    """One run and its progress."""

    announced: RunConfiguration
    backend: Backend
    stamps_ns: "array[int]" = field(default_factory=lambda: array("q"))  # of the known keyframes
    repeated: int = -1  # index of the last requested keyframe if it was already known, else -1
    is_announced_again: bool = False

    @property
    def num_known(self) -> int:
        """Number of keyframes that are known."""
        return len(self.stamps_ns)


@dataclass
class WorkOrder:
    """Passes messages in the right order to the backends of the announced runs and returns their answers.

    ``make_backend`` makes the backend of one run; ``dropped`` counts messages not used, by reason; ``repeated`` counts
    repeated messages, by topic.
    """

    make_backend: Callable[[], Backend]
    dropped: Counter[str] = field(default_factory=Counter)
    repeated: Counter[str] = field(default_factory=Counter)
    _runs: dict[str, _Run] = field(default_factory=dict)
    _keyframes: Waiting[Keyframe] = field(default_factory=lambda: Waiting(topics.KEYFRAMES))
    _commits: Waiting[Commit] = field(default_factory=lambda: Waiting(topics.COMMITS))

    @property
    def disk_fault(self) -> str:
        """Why keyframes of a run are in memory instead of on disk; "" if there is no such fault."""
        return next((fault for run in self._runs.values() if (fault := run.backend.steps.disk_fault)), "")

    @property
    def num_rebuilt(self) -> int:
        """Components rebuilt so far."""
        return sum(run.backend.num_rebuilt for run in self._runs.values())

    @property
    def num_replayed(self) -> int:
        """Keyframes replayed so far to rebuild components."""
        return sum(run.backend.num_replayed for run in self._runs.values())

    @property
    def checkpoint_faults(self) -> Counter[str]:
        """What went wrong with checkpoints, by reason."""
        return sum((run.backend.trunks.faults for run in self._runs.values()), Counter[str]())

    def close(self) -> None:
        """Leave the folders of all runs."""
        for run in self._runs.values():
            run.backend.trunks.close()

    def take(self, data: bytes, type_name: str, *, more: bool = False) -> list[Answer]:
        """Process a serialised message and return the answers; an invalid one is counted.

        ``more``: further messages are queued; no buffered work is started before they are taken, too.
        """
        try:
            answers = self._taken(data, type_name)
        except MessageError as fault:
            self.dropped[f"{TOPICS[type_name]}: {fault.kind}"] += 1
            answers = []
        return answers if more else answers + self.advance()

    def _taken(self, data: bytes, type_name: str) -> list[Answer]:
        """Decode a message, handle it, and return immediate answers. Raises MessageError."""
        message = deserialize(data, type_name)
        value = from_message(message)
        if isinstance(value, Keyframe):
            return self.keyframe(str(message.run_id), value, again=bool(message.again))
        if isinstance(value, RunConfiguration):
            self.start(value)
            return []
        return self.commit(value)

    def start(self, run: RunConfiguration) -> None:
        """Start an announced run; a repeated announcement may come from a restarted manager.

        Raises MessageError if its id does not match its contents or the backend cannot start it.
        """
        known = self._runs.get(run.run_id)
        if known is not None:
            known.is_announced_again = True
            self.repeated[topics.RUN_CONFIGURATION] += 1
            return
        self._runs[run.run_id] = _Run(run, self._started(run))
        if len(self._runs) > MOST_RUNS:
            idle = [name for name, other in self._runs.items() if not other.num_known and name != run.run_id]
            self._runs.pop(idle[0] if idle else next(iter(self._runs))).backend.trunks.close()

    def keyframe(self, run_id: str, keyframe: Keyframe, *, again: bool = False) -> list[Answer]:
        """Round one: buffer a keyframe; returns the answer if it is known and requested again.

        ``again``: it is sent for backends that have missed it; the others do not answer.
        """
        fault = fault_of_keyframe(keyframe)
        if fault:
            self.dropped[f"{topics.KEYFRAMES}: {fault}"] += 1
            return []
        run = self._runs.get(run_id)
        if run is not None and keyframe.index < run.num_known:
            if keyframe.stamp_ns == run.stamps_ns[keyframe.index]:
                self.repeated[topics.KEYFRAMES] += 1
                return [] if again else self._asked_again(run, keyframe)
            if not run.is_announced_again:
                self.dropped[f"{topics.KEYFRAMES}: of an earlier keyframe"] += 1
                return []
            self._begin_anew(run)
        return self._keep(self._keyframes, run_id, keyframe.index, keyframe)

    def commit(self, commit: Commit) -> list[Answer]:
        """Round two: returns the answer if its keyframe is known, else buffers the commit. Commits are idempotent."""
        run = self._runs.get(commit.run_id)
        if run is not None and commit.keyframe < run.num_known:
            self.dropped += self._commits.without_others(self._runs)
            return self._followed(run, commit)
        return self._keep(self._commits, commit.run_id, commit.keyframe, commit)

    def advance(self) -> list[Answer]:
        """Process all buffered messages whose predecessors are known, in order."""
        return [answer for run_id, run in self._runs.items() for answer in self._advanced(run_id, run)]

    def _started(self, run: RunConfiguration) -> Backend:
        if not is_id_of_its_contents(run):
            raise MessageError("run configuration: its id is not that of its contents", "id of another run")
        backend = self.make_backend()
        try:
            backend.start(run)
        except (InputError, ValueError, RecursionError) as fault:
            text = one_line(fault, 200)
            raise MessageError(
                f"run configuration: no run can be made of it ({text})", "no run can be made of it"
            ) from None
        return backend

    @staticmethod
    def _asked_again(run: _Run, keyframe: Keyframe) -> list[Answer]:
        """Answer a repeated request of the keyframe due next, or of another one if requested twice in succession.

        A restarted manager that requests a keyframe twice has lost everything after it that this backend has done.
        """
        is_due = keyframe.index in (run.backend.committed + 1, run.repeated)
        run.repeated = keyframe.index
        return [run.backend.expand(keyframe)] if is_due else []

    @staticmethod
    def _begin_anew(run: _Run) -> None:
        """Reset a run for a manager that was restarted with other keyframes, the earlier ones of which are asked for.

        It began without a journal, or went back to what is before the damage in one.
        """
        run.backend.start(run.announced)
        run.is_announced_again, run.stamps_ns, run.repeated = False, array("q"), -1

    def _keep(self, waiting: Waiting[Any], run_id: str, index: int, value: Any) -> list[Answer]:
        """Buffer a message until its predecessors have arrived, or request the missing keyframes.

        Since a topic keeps its order, a gap in an announced run means that this backend has missed messages, and
        buffered messages of runs that are not announced are obsolete.
        """
        run = self._runs.get(run_id)
        if run is not None:
            self.dropped += waiting.without_others(self._runs)
            first = next(n for n in count(run.num_known) if not self._keyframes.has(run_id, n))
            follows = waiting is self._commits and waiting.has(run_id, index - 1)
            if index > first and not follows:
                self.dropped[f"{waiting.topic}: out of turn"] += 1
                return [MissedKeyframes(run_id=run_id, backend_id=run.backend.backend_id, keyframe=first)]
        self.dropped += waiting.keep(run_id, index, value)
        return []

    def _advanced(self, run_id: str, run: _Run) -> list[Answer]:
        answers: list[Answer] = []
        while True:
            keyframe = self._keyframes.pop(run_id, run.num_known)
            commit = self._commits.pop(run_id, run.num_known - 1)
            if keyframe is not None:
                answers += self._began(run, keyframe, self._keyframes.has(run_id, keyframe.index + 1))
            elif commit is not None:
                answers += self._followed(run, commit)
            else:
                return answers

    @staticmethod
    def _began(run: _Run, keyframe: Keyframe, has_successor: bool) -> list[Answer]:
        """Round one of a new keyframe; with a successor queued it is only stored, as no manager awaits the answer."""
        run.stamps_ns.append(keyframe.stamp_ns)
        run.repeated = -1
        if has_successor:
            run.backend.learn(keyframe)
            return []
        return [run.backend.expand(keyframe)]

    def _followed(self, run: _Run, commit: Commit) -> list[Answer]:
        """The answer to a commit; none to an invalid one, which is counted, or to a stale one."""
        run.repeated = -1
        fault = fault_of_commit(commit, run.stamps_ns[commit.keyframe])
        if fault:
            self.dropped[f"{topics.COMMITS}: {fault}"] += 1
            return []
        self.repeated[topics.COMMITS] += commit.keyframe <= run.backend.committed
        answer = run.backend.commit(commit)
        return [answer] if answer is not None else []
