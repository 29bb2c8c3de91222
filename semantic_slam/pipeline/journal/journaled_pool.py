"""Backends whose answers are kept in a journal, and are taken from there until it ends."""

import struct
from collections.abc import Mapping
from typing import Any, Protocol

from semantic_slam.errors import InputError
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import BackendPool, Candidates, Commit, Components, RunConfiguration
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode, encode
from semantic_slam.pipeline.journal.journal import NoJournal, Record

COUNT = struct.Struct("<I")


class TeachablePool(BackendPool, Protocol):
    """A pool whose backends may have missed keyframes."""

    def tell(self, keyframe: Keyframe) -> None:
        """Let those backends know a keyframe that do not; nobody answers."""


class JournaledPool:
    """``pool`` behind ``journal``: an engine that goes on after a restart sees the answers, and who gave them, again.

    The backends are told of the keyframes, without work, so that new ones among them can rebuild what they are given.
    """

    def __init__(self, pool: TeachablePool, journal: NoJournal) -> None:
        self._pool, self._journal = pool, journal

    @property
    def backend_ids(self) -> tuple[int, ...]:
        """Numbers of the backends that take part now."""
        return self._pool.backend_ids

    @backend_ids.setter
    def backend_ids(self, numbers: tuple[int, ...]) -> None:
        self._pool.backend_ids = numbers

    def start(self, run: RunConfiguration) -> None:
        """Begin a run."""
        self._pool.start(run)

    def expand(self, keyframe: Keyframe) -> list[Candidates]:
        """Round one; what the journal has of it, or else what the backends answer."""
        if self._journal.next is not None:
            self._pool.tell(keyframe)
            return self._kept(topics.CANDIDATES, keyframe.index)
        return self._keep(topics.CANDIDATES, self._pool.expand(keyframe))

    def commit(self, commit: Commit) -> list[Components]:
        """Round two, likewise."""
        if self._journal.next is not None:
            return self._kept(topics.COMPONENTS, commit.keyframe)
        return self._keep(topics.COMPONENTS, self._pool.commit(commit))

    def offer(self, components: Mapping[int, Component]) -> None:
        """Components that the next commit need not rebuild; of no use where the journal has its answers."""
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
