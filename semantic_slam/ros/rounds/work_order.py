"""The order of a backend's work: announcement, then keyframe and commit in turn, whatever the order of arrival.

Each topic keeps its own order, different topics have none: a commit may arrive before the keyframe it belongs to, and
after a restart all of them arrive at once. Whoever asks for a keyframe has done with those before: their commits are
not waited for, and of a heap of keyframes all but the newest are only learnt. A backend that was started late, or
again, asks for the keyframes that it has missed. What does not belong to the run, or cannot be, is counted and changes
nothing: it serves whoever announced a run, and another announcement silences nobody. Nothing here knows ROS.
"""

from array import array
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count
from typing import Any

from semantic_slam.errors import InputError, MessageError
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
"""Runs that a backend holds: that of its manager, and that of the one before it, or of whoever else announced one."""
TOPICS = {topics.TYPES[topic]: topic for topic in (topics.RUN_CONFIGURATION, topics.KEYFRAMES, topics.COMMITS)}


@dataclass
class _Run:
    """One run, and how far it has come."""

    announced: RunConfiguration
    backend: Backend
    stamps_ns: "array[int]" = field(default_factory=lambda: array("q"))  # of the keyframes that are known
    repeated: int = -1  # the keyframe that came last, when it was known before
    is_announced_again: bool = False

    @property
    def num_known(self) -> int:
        """Keyframes that are known."""
        return len(self.stamps_ns)


@dataclass
class WorkOrder:
    """Feeds the backends of announced runs and returns their answers; ``dropped`` counts what was not used, by reason.

    ``make_backend`` makes the backend of one run; ``repeated`` counts what came before, by topic.
    """

    make_backend: Callable[[], Backend]
    dropped: Counter[str] = field(default_factory=Counter)
    repeated: Counter[str] = field(default_factory=Counter)
    _runs: dict[str, _Run] = field(default_factory=dict)
    _keyframes: Waiting[Keyframe] = field(default_factory=lambda: Waiting(topics.KEYFRAMES))
    _commits: Waiting[Commit] = field(default_factory=lambda: Waiting(topics.COMMITS))

    @property
    def disk_fault(self) -> str:
        """Why keyframes of a run stay in memory that should be on disk; "" where none do."""
        return next((fault for run in self._runs.values() if (fault := run.backend.steps.disk_fault)), "")

    def take(self, data: bytes, type_name: str, *, more: bool = False) -> list[Answer]:
        """The answers to a message of the wire; one that cannot be used is counted.

        With ``more``, messages that have arrived already, nothing new is begun before they are taken, too.
        """
        try:
            answers = self._taken(data, type_name)
        except MessageError as fault:
            self.dropped[f"{TOPICS[type_name]}: {fault.kind}"] += 1
            answers = []
        return answers if more else answers + self.advance()

    def _taken(self, data: bytes, type_name: str) -> list[Answer]:
        """What is answered at once."""
        message = deserialize(data, type_name)
        value = from_message(message)
        if isinstance(value, Keyframe):
            return self.keyframe(str(message.run_id), value, again=bool(message.again))
        if isinstance(value, RunConfiguration):
            self.start(value)
            return []
        return self.commit(value)

    def start(self, run: RunConfiguration) -> None:
        """A run is announced; a second announcement may come from a manager that was started anew.

        Raises MessageError where no run can be made of it.
        """
        known = self._runs.get(run.run_id)
        if known is not None:
            known.is_announced_again = True
            self.repeated[topics.RUN_CONFIGURATION] += 1
            return
        self._runs[run.run_id] = _Run(run, self._started(run))
        if len(self._runs) > MOST_RUNS:
            idle = [name for name, other in self._runs.items() if not other.num_known and name != run.run_id]
            del self._runs[idle[0] if idle else next(iter(self._runs))]

    def keyframe(self, run_id: str, keyframe: Keyframe, *, again: bool = False) -> list[Answer]:
        """Round one; the answer where the keyframe is known, and is asked for again.

        With ``again`` it is told to those who have missed it, and nobody else is asked.
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
            if keyframe.index or not run.is_announced_again:
                self.dropped[f"{topics.KEYFRAMES}: of an earlier keyframe"] += 1
                return []
            self._begin_anew(run)
        return self._keep(self._keyframes, run_id, keyframe.index, keyframe)

    def commit(self, commit: Commit) -> list[Answer]:
        """Round two; the answer where its keyframe is known. In the backend a repeated one is idempotent."""
        run = self._runs.get(commit.run_id)
        if run is not None and commit.keyframe < run.num_known:
            self.dropped += self._commits.without_others(self._runs)
            return self._followed(run, commit)
        return self._keep(self._commits, commit.run_id, commit.keyframe, commit)

    def advance(self) -> list[Answer]:
        """Do all that can be done by now, in turn."""
        return [answer for run_id, run in self._runs.items() for answer in self._advanced(run_id, run)]

    def _started(self, run: RunConfiguration) -> Backend:
        if not is_id_of_its_contents(run):
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

    @staticmethod
    def _asked_again(run: _Run, keyframe: Keyframe) -> list[Answer]:
        """A keyframe that is due is answered again; another one when it comes twice in succession.

        Where a manager that goes on after a restart asks for one twice, there it stands: it lost what this backend has
        done since.
        """
        is_due = keyframe.index in (run.backend.committed + 1, run.repeated)
        run.repeated = keyframe.index
        return [run.backend.expand(keyframe)] if is_due else []

    @staticmethod
    def _begin_anew(run: _Run) -> None:
        """A manager that was started anew has other keyframes."""
        run.backend.start(run.announced)
        run.is_announced_again, run.stamps_ns, run.repeated = False, array("q"), -1

    def _keep(self, waiting: Waiting[Any], run_id: str, index: int, value: Any) -> list[Answer]:
        """Let a message wait for those before it, or ask for the keyframes that are missing.

        A topic keeps its order, and so leaves out none of an announced run that this backend was there for; nor does
        anything follow there on what is of another run, unless its announcement has come meanwhile.
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
        """Round one of a keyframe that was not known; nobody waits for it when there is one after it."""
        run.stamps_ns.append(keyframe.stamp_ns)
        run.repeated = -1
        if has_successor:
            run.backend.learn(keyframe)
            return []
        return [run.backend.expand(keyframe)]

    def _followed(self, run: _Run, commit: Commit) -> list[Answer]:
        """The answer to a commit; none to one that contradicts itself, which is counted, or to a stale one."""
        run.repeated = -1
        fault = fault_of_commit(commit, run.stamps_ns[commit.keyframe])
        if fault:
            self.dropped[f"{topics.COMMITS}: {fault}"] += 1
            return []
        self.repeated[topics.COMMITS] += commit.keyframe <= run.backend.committed
        answer = run.backend.commit(commit)
        return [answer] if answer is not None else []
