"""The manager's backends behind topics."""

import queue
import time
from collections import Counter
from collections.abc import Sequence
from typing import Any

import rclpy
from rclpy.node import Node

from semantic_slam.errors import MessageError, SemanticSlamError
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import Candidates, Commit, Components, RunConfiguration
from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode, encode
from semantic_slam.ros import qos
from semantic_slam.ros.health import SILENT_AFTER_S, Level, Status
from semantic_slam.ros.liveliness import Watch
from semantic_slam.ros.transport import Outlet, private_name, receive

CHECK_S = 0.2
PATIENCE_S = 0.5
"""For which a sign of life may be missing: after a pause of the whole machine all are, and return at once."""


class RosPool:
    """A ``BackendPool`` over topics. Its rounds run on the worker's thread, the answers arrive on the executor's.

    A backend whose sign of life is missing for ``PATIENCE_S``, or that does not answer within ``timeout_s``, is given
    up: the manager rebuilds its hypotheses elsewhere.
    """

    def __init__(self, node: Node, backend_ids: Sequence[int], timeout_s: float) -> None:
        self.backend_ids = tuple(backend_ids)
        self._timeout_s = timeout_s
        self._run_id = ""
        self.refused: Counter[str] = Counter()  # answers that could not be used, by topic and kind
        self._given_up: tuple[int, ...] = ()
        self._logger = node.get_logger()
        self._watch = Watch(node, backend_ids)
        self._awaited: tuple[int, ...] = ()
        self._since_s = time.monotonic()
        self._what = ""
        self._run = self._outlet(node, topics.RUN_CONFIGURATION, qos.latched())
        self._keyframes = self._outlet(node, topics.KEYFRAMES, qos.everything_from_the_start())
        self._commits = self._outlet(node, topics.COMMITS, qos.everything_from_the_start())
        self._candidates = self._inlet(node, topics.CANDIDATES)
        self._components = self._inlet(node, topics.COMPONENTS)

    def start(self, run: RunConfiguration) -> None:
        """Announce the run; backends that start later receive it, too."""
        self._run_id = run.run_id
        self._run.send(encode(run))

    def expand(self, keyframe: Keyframe) -> list[Candidates]:
        """Round one: the candidates of every live hypothesis."""
        self._keyframes.send(encode(keyframe, run_id=self._run_id))
        return self._collect(self._candidates, topics.CANDIDATES, keyframe.index)

    def commit(self, commit: Commit) -> list[Components]:
        """Round two: the survivors forked, updated and reported."""
        self._commits.send(encode(commit))
        return self._collect(self._components, topics.COMPONENTS, commit.keyframe)

    def statuses(self) -> list[Status]:
        """Which backends are silent or given up."""
        waiting_s, awaited = time.monotonic() - self._since_s, self._awaited
        silent = awaited if waiting_s > SILENT_AFTER_S else ()
        return [
            *(self._presence(n) for n in self.backend_ids if n not in silent),
            *(
                Status(
                    f"backend_{n}",
                    Level.WARN,
                    f"backend_{n} is silent: no {self._what} for {waiting_s:.0f} s; start it",
                )
                for n in silent
            ),
            *(
                Status(f"backend_{n}", Level.ERROR, f"backend_{n} was given up; its hypotheses moved to other backends")
                for n in self._given_up
            ),
        ]

    def _presence(self, number: int) -> Status:
        """Status of a backend that does not owe an answer for long."""
        name = f"backend_{number}"
        if not self._watch.was_seen(number):
            return Status(name, Level.WARN, f"{name} is not there; start it")
        missing_s = self._watch.missing_s(number)
        if missing_s > PATIENCE_S:
            return Status(name, Level.WARN, f"{name} has been gone for {missing_s:.0f} s; start the replay again")
        return Status(name, Level.OK, "answering")

    def _collect(self, answers: "queue.SimpleQueue[bytes]", topic: str, index: int) -> list[Any]:
        """One answer of every backend, in the order of their ids; what belongs to another round is ignored."""
        collected: dict[int, Any] = {}
        self._what, self._since_s = f"{topic.rsplit('/', 1)[-1]} of keyframe {index}", time.monotonic()
        self._awaited = self.backend_ids
        while self._awaited:
            try:
                answer = decode(answers.get(timeout=CHECK_S), topics.TYPES[topic])
            except queue.Empty:
                self._check()
                continue
            except MessageError as fault:
                self.refused[f"{topic}: {fault.kind}"] += 1
                continue
            if (answer.run_id, answer.keyframe) == (self._run_id, index) and answer.backend_id in self._awaited:
                collected[answer.backend_id] = answer
                self._awaited = tuple(n for n in self._awaited if n != answer.backend_id)
        return [collected[n] for n in sorted(collected)]

    def _check(self) -> None:
        if not rclpy.ok():
            raise SemanticSlamError("interrupted while waiting for backends")
        late = time.monotonic() - self._since_s > self._timeout_s
        gone = {n for n in self._awaited if self._watch.missing_s(n) > PATIENCE_S}
        for number in [n for n in self._awaited if late or n in gone]:
            reason = "is gone" if number in gone else f"has not answered for {self._timeout_s:.0f} s"
            self._logger.warning(f"backend_{number} {reason}; its hypotheses move to other backends")
            self._given_up += (number,)
            self._awaited = tuple(n for n in self._awaited if n != number)
        self.backend_ids = tuple(n for n in self.backend_ids if n not in self._given_up)

    @staticmethod
    def _outlet(node: Node, topic: str, profile: Any) -> Outlet:
        return Outlet(node, private_name(topic), topics.TYPES[topic], profile)

    @staticmethod
    def _inlet(node: Node, topic: str) -> "queue.SimpleQueue[bytes]":
        answers: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        receive(node, topic, answers.put, qos.everything())
        return answers
