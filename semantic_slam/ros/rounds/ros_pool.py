"""The manager's pool of backend nodes, reached over topics."""

import json
import queue
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import rclpy
from rclpy.node import Node

from semantic_slam.configuration import from_dict
from semantic_slam.errors import MessageError, SemanticSlamError
from semantic_slam.inference.checkpoints.stored_trunks import folder_of
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import Candidates, Commit, Components, RunConfiguration
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode, encode
from semantic_slam.pipeline.journal.kept_run import KeptRun
from semantic_slam.pipeline.journal.kept_runs import KeptRuns
from semantic_slam.ros.node.health import SILENT_AFTER_S, Level, Status
from semantic_slam.ros.rounds.liveliness import Watch
from semantic_slam.ros.rounds.missed import MissedQuestions
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet, private_name, receive
from semantic_slam.run_folder import RunFolder

CHECK_S = 0.2
ASK_AGAIN_S = 5.0
"""A backend that does not answer is asked again after this time: an answer sent before DDS has matched the manager is
lost, and a repeated request costs the backend nothing.
"""
PATIENCE_S = 0.5
"""Tolerated loss of liveliness: after a suspend of the machine all backends lose it, and regain it at once."""


class Begun(NamedTuple):
    """A round that backends were asked to begin."""

    keyframe: int
    request: bytes
    readers: int  # matched with the topic when it was sent


class RosPool:
    """A ``BackendPool`` over topics; rounds run on the worker's thread, answers arrive on the executor's thread.

    A backend without liveliness for ``PATIENCE_S``, or without an answer within ``timeout_s``, is given up: the manager
    rebuilds its hypotheses on other backends. The last backend is given up only if it is late and not alive: it may be
    restarted, and may then replay for long. A backend that was started late is sent the keyframes it has missed and
    takes part again from its first answer, at which it knows all keyframes.
    """

    def __init__(self, node: Node, backend_ids: Sequence[int], timeout_s: float) -> None:
        self.backend_ids = tuple(backend_ids)
        self.timeout_s = timeout_s
        self.runs = KeptRuns()  # may be replaced before the first run
        self.kept: KeptRun  # the keyframes of the run; set by start()
        self._run_id = ""
        self._checkpoints: RunFolder | None = None  # stays while no backend is there
        self.refused: Counter[str] = Counter()  # answers that could not be used, by topic and reason
        self.repeated: Counter[str] = Counter()  # answers that are repeated or no longer awaited, by topic
        self._all_ids = frozenset(backend_ids)
        self._back: set[int] = set()  # backends that were given up and answer again
        self._logger = node.get_logger()
        self._watch = Watch(node, backend_ids)
        self._begun: Begun | None = None  # round one, begun and not collected
        self._awaited: tuple[int, ...] = ()
        self._goes_on = False  # recovering after a restart, no keyframe requested since
        self._since_s = time.monotonic()
        self._what = ""
        self._run = self._outlet(node, topics.RUN_CONFIGURATION, qos.latched())
        self._keyframes = self._outlet(node, topics.KEYFRAMES, qos.everything())
        self._commits = self._outlet(node, topics.COMMITS, qos.everything())
        self._candidates = self._inlet(node, topics.CANDIDATES)
        self._components = self._inlet(node, topics.COMPONENTS)
        self._missed = MissedQuestions(backend_ids, self.refused, self.repeated)
        receive(node, topics.MISSED, self._missed.ask, qos.everything())

    def start(self, run: RunConfiguration) -> None:
        """Publish the run's configuration, latched, so that backends that start later receive it, too."""
        self._run_id, self.kept, self._begun = run.run_id, self.runs.begin(run), None
        self._goes_on = self.kept.num_keyframes > 0
        self.close()
        if from_dict(json.loads(run.configuration), "run configuration").history.is_on:
            self._checkpoints = folder_of(run.run_id)
        self._run.send(encode(run))

    def close(self) -> None:
        """Leave the folder with the checkpoints of this host's backends."""
        if self._checkpoints is not None:
            self._checkpoints.leave()
            self._checkpoints = None

    def tell(self, keyframe: Keyframe) -> None:
        """Keep a keyframe for backends that will miss it, without requesting an answer."""
        self.kept.add(keyframe)
        self._goes_on = True

    def begin(self, keyframe: Keyframe) -> None:
        """Request the candidates of every live hypothesis, which :meth:`expand` then collects."""
        self._begun = self._requested(keyframe)

    def _requested(self, keyframe: Keyframe) -> Begun:
        self.kept.add(keyframe)
        request = encode(keyframe, run_id=self._run_id)
        if self._goes_on:  # backends may be ahead: a request sent twice tells them where the manager is
            self._keyframes.send(request)
            self._goes_on = False
        begun = Begun(keyframe.index, request, self._keyframes.num_readers)
        self._keyframes.send(request)
        return begun

    def expand(self, keyframe: Keyframe) -> list[Candidates]:
        """Round one: the candidates of every live hypothesis."""
        begun, self._begun = self._begun, None
        if begun is None or begun.keyframe != keyframe.index:
            begun = self._requested(keyframe)
        answers = self._collected(self._keyframes, self._candidates, topics.CANDIDATES, begun)
        self._welcome()
        return answers

    def commit(self, commit: Commit) -> list[Components]:
        """Round two: request the components of the surviving hypotheses, which the backends fork and update."""
        begun = Begun(commit.keyframe, encode(commit), self._commits.num_readers)
        self._commits.send(begun.request)
        return self._collected(self._commits, self._components, topics.COMPONENTS, begun)

    def offer(self, components: Mapping[int, Component]) -> None:
        """Does nothing: backends in other processes rebuild the components that they are to hold."""

    @property
    def _given_up(self) -> frozenset[int]:
        """Backends that are not asked: before a restart of the manager, too, as its journal restores those that are."""
        return self._all_ids - frozenset(self.backend_ids)

    def _welcome(self) -> None:
        """Readmit backends that are back; they get hypotheses according to the ownership rule."""
        for number in sorted(self._back):
            self._logger.info(f"backend_{number} is back")
        self.backend_ids = tuple(sorted({*self.backend_ids, *self._back}))
        self._back = set()

    def statuses(self) -> list[Status]:
        """Statuses of the backends, and a warning if keyframes missed by a restarted backend cannot be sent."""
        waiting_s, awaited = time.monotonic() - self._since_s, self._awaited
        silent = awaited if waiting_s > SILENT_AFTER_S else ()
        return [
            *(self._presence(n) for n in self.backend_ids if n not in silent),
            *(self._silence(n, waiting_s) for n in silent),
            *(self._absence(n) for n in sorted(self._given_up)),
            *(self._double(n) for n in sorted(self._all_ids) if self._watch.several_s(n) > SILENT_AFTER_S),
            *self._memory_statuses(),
        ]

    def _silence(self, number: int, waiting_s: float) -> Status:
        """Status of a backend that is overdue with an answer; one that is alive computes."""
        name, lacks = f"backend_{number}", f"no {self._what} for {waiting_s:.0f} s"
        if self._watch.is_alive(number):
            return Status(name, Level.WARN, f"{name} is busy: {lacks}; if it often is, lower pruning.max_hypotheses")
        return Status(name, Level.WARN, f"{name} is silent: {lacks}; start it")

    def _absence(self, number: int) -> Status:
        """Status of a backend that was given up; one that is alive takes part again from its next answer."""
        name = f"backend_{number}"
        if self._watch.is_alive(number):
            text = f"{name} was given up, and is there: it takes part again from the next keyframe that it answers"
            return Status(name, Level.WARN, text)
        text = f"{name} was given up; its hypotheses moved to other backends; start it again"
        return Status(name, Level.ERROR, text)

    @staticmethod
    def _double(number: int) -> Status:
        name = f"backend_{number}"
        text = f"{name} runs more than once, and all do its work; end all but one, or give them numbers of their own"
        return Status(f"{name} twice", Level.WARN, text)

    def _memory_statuses(self) -> list[Status]:
        fault = self.kept.fault if self._run_id else ""
        text = f"{fault}; until then a backend that is started again cannot take part"
        return [Status("memory of keyframes", Level.WARN, text)] if fault else []

    def _presence(self, number: int) -> Status:
        """Status, by liveliness, of a backend that is not overdue with an answer."""
        name = f"backend_{number}"
        if not self._watch.was_seen(number):
            return Status(name, Level.WARN, f"{name} is not there; start it")
        missing_s = self._watch.missing_s(number)
        if missing_s > PATIENCE_S:
            return Status(name, Level.WARN, f"{name} has been gone for {missing_s:.0f} s; start it again")
        return Status(name, Level.OK, "answering")

    def _collected(self, outlet: Outlet, answers: "queue.SimpleQueue[bytes]", topic: str, begun: Begun) -> list[Any]:
        """Collect one answer per backend to a request, ordered by id; backends may be given up meanwhile."""
        collected: dict[int, Any] = {}
        index, request, readers = begun
        self._what, self._since_s = f"{topic.rsplit('/', 1)[-1]} of keyframe {index}", time.monotonic()
        self._awaited = self.backend_ids
        asked_s = self._since_s
        while self._awaited:
            answer = self._next(answers, topic)
            knows_all = self._missed.answer(self._run_id, self.kept, index + 1, self._keyframes)
            is_missed = knows_all and outlet is self._commits
            if answer is None:
                self._check()
                came, readers = outlet.num_readers > readers, outlet.num_readers
                is_missed |= came or time.monotonic() - asked_s > ASK_AGAIN_S
            if is_missed:
                outlet.send(request)
                asked_s = time.monotonic()
            if answer is None:
                continue
            if answer.keyframe == index and answer.backend_id in self._awaited:
                collected[answer.backend_id] = answer
                self._awaited = tuple(n for n in self._awaited if n != answer.backend_id)
            else:
                self._note(answer, topic, index)
        return [collected[n] for n in sorted(collected)]

    def _note(self, answer: Any, topic: str, index: int) -> None:
        """Classify an answer that is not awaited: from a returning backend, of a past round, or invalid."""
        if answer.backend_id not in self._all_ids:
            self.refused[f"{topic}: of a backend that there is not"] += 1
        elif answer.keyframe > index:
            self.refused[f"{topic}: of a keyframe that nobody asked for"] += 1
        else:
            self.repeated[topic] += 1
            if topic == topics.CANDIDATES and answer.keyframe >= index - 1 and answer.backend_id in self._given_up:
                self._back.add(answer.backend_id)

    def _next(self, answers: "queue.SimpleQueue[bytes]", topic: str) -> Any:
        """The next valid answer of this run; None if none arrives within ``CHECK_S`` or it is refused."""
        try:
            answer = decode(answers.get(timeout=CHECK_S), topics.TYPES[topic])
        except queue.Empty:
            return None
        except MessageError as fault:
            self.refused[f"{topic}: {fault.kind}"] += 1
            return None
        if answer.run_id != self._run_id:
            self.refused[f"{topic}: of another run"] += 1
            return None
        return answer

    def _check(self) -> None:
        if not rclpy.ok():
            raise SemanticSlamError("interrupted while waiting for backends")
        late = time.monotonic() - self._since_s > self.timeout_s
        for number in self._awaited:
            is_gone = self._watch.missing_s(number) > PATIENCE_S
            if not self._is_given_up(number, late=late, is_gone=is_gone):
                continue
            reason = "is gone" if is_gone else f"has not answered for {self.timeout_s:.0f} s"
            self._logger.warning(f"backend_{number} {reason}; its hypotheses move to other backends")
            self._awaited = tuple(n for n in self._awaited if n != number)
            self.backend_ids = tuple(n for n in self.backend_ids if n != number)

    def _is_given_up(self, number: int, *, late: bool, is_gone: bool) -> bool:
        """Whether a backend is given up: the last one only if it is late and not alive, for a replay may take long."""
        if len(self.backend_ids) > 1:
            return late or is_gone
        return late and (is_gone or not self._watch.was_seen(number))

    @staticmethod
    def _outlet(node: Node, topic: str, profile: Any) -> Outlet:
        return Outlet(node, private_name(topic), topics.TYPES[topic], profile)

    @staticmethod
    def _inlet(node: Node, topic: str) -> "queue.SimpleQueue[bytes]":
        answers: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        receive(node, topic, answers.put, qos.everything())
        return answers
