"""Backend pool whose answers are recorded in a journal, and replayed from it after a restart."""

import struct
from collections.abc import Mapping
from typing import Any, Protocol

from semantic_slam.errors import InputError
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import BackendPool, Candidates, Commit, Components, RunConfiguration
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode, encode
from semantic_slam.pipeline.journal.journal import NoJournal
from semantic_slam.pipeline.journal.segment import Record

COUNT = struct.Struct("<I")


class TeachablePool(BackendPool, Protocol):
    """Backend pool that can send keyframes to backends that have missed them."""

    def tell(self, keyframe: Keyframe) -> None:
        """Make a keyframe known to backends that miss it, without an answer."""


class JournaledPool:
    """Wraps ``pool`` with ``journal``: after a restart the engine gets the recorded answers, and backend ids, again.

    During the replay the backends are only told the keyframes, without work, so that new ones can later rebuild the
    hypotheses they are given.
    """

    def __init__(self, pool: TeachablePool, journal: NoJournal) -> None:
        self._pool, self._journal = pool, journal
        self._told: Keyframe | None = None  # keyframe whose candidates were in the journal, until its commit

    @property
    def backend_ids(self) -> tuple[int, ...]:
        """Ids of the backends that take part now."""
        return self._pool.backend_ids

    @backend_ids.setter
    def backend_ids(self, numbers: tuple[int, ...]) -> None:
        self._pool.backend_ids = numbers

    def start(self, run: RunConfiguration) -> None:
        """Start a run."""
        self._pool.start(run)

    def begin(self, keyframe: Keyframe) -> None:
        """Have the backends begin round one, unless its answers are in the journal."""
        if self._journal.next is None:
            self._pool.begin(keyframe)

    def expand(self, keyframe: Keyframe) -> list[Candidates]:
        """Round one: the answers from the journal, or else those of the backends."""
        if self._journal.next is not None:
            self._pool.tell(keyframe)
            self._told = keyframe
            return self._kept(topics.CANDIDATES, keyframe.index)
        self._told = None
        return self._keep(topics.CANDIDATES, self._pool.expand(keyframe))

    def commit(self, commit: Commit) -> list[Components]:
        """Round two: the answers from the journal, or else those of the backends."""
        if self._journal.next is not None:
            return self._kept(topics.COMPONENTS, commit.keyframe)
        if self._told is not None and self._journal.is_damaged:
            self._pool.expand(
                self._told
            )  # backends that lived on are ahead, and go back to the keyframe of this commit
        return self._keep(topics.COMPONENTS, self._pool.commit(commit))

    def offer(self, components: Mapping[int, Component]) -> None:
        """Offer components that the next commit need not rebuild; not needed while replaying the journal."""
        if self._journal.next is None:
            self._pool.offer(components)

    def _keep(self, topic: str, answers: list[Any]) -> list[Any]:
        self._journal.append(topic, _packed(self.backend_ids, [encode(answer) for answer in answers]))
        return answers

    def _kept(self, topic: str, keyframe: int) -> list[Any]:
        record = self._journal.take()
        backend_ids, answers = _unpacked(record)
        values = [decode(data, topics.TYPES[topic]) for data in answers] if record.name == topic else []
        if record.name != topic or any(value.keyframe != keyframe for value in values):
            raise InputError(f"the journal has {record.name} in place of {topic} of keyframe {keyframe}; remove it")
        self._pool.backend_ids = backend_ids
        return values


def _packed(backend_ids: tuple[int, ...], answers: list[bytes]) -> bytes:
    numbers = b"".join(COUNT.pack(number) for number in (len(backend_ids), *backend_ids))
    return numbers + b"".join(COUNT.pack(len(answer)) + answer for answer in answers)


def _unpacked(record: Record) -> tuple[tuple[int, ...], list[bytes]]:
    data = record.data
    count = COUNT.unpack_from(data)[0] if len(data) >= COUNT.size else 0
    at, backend_ids = COUNT.size, []
    for _ in range(count):
        backend_ids.append(COUNT.unpack_from(data, at)[0])
        at += COUNT.size
    answers = []
    while at < len(data):
        size = COUNT.unpack_from(data, at)[0]
        answers.append(data[at + COUNT.size : at + COUNT.size + size])
        at += COUNT.size + size
    return tuple(backend_ids), answers
