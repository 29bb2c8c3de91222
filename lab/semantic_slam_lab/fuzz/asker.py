"""Asks the services of a run what they cannot answer, and keeps what they say."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from numpy.random import Generator
from rclpy.client import Client
from rclpy.node import Node

from semantic_slam_lab.fuzz.questions import Question, question


class Asker:
    """Sends questions and waits for no answer; answers come while somebody spins the node."""

    def __init__(self, node: Node, folder: Path) -> None:
        self._node, self._folder = node, folder
        self._clients: dict[str, Client] = {}
        self._asked: list[tuple[Question, Any]] = []

    @property
    def num_asked(self) -> int:
        return len(self._asked)

    def ask(self, chance: Generator) -> None:
        """One question, unless the node that it is for is not there."""
        made = question(self._folder, chance)
        name = f"{made.node}/{made.service}"
        if name not in self._clients:
            self._clients[name] = self._node.create_client(made.kind, name)
        if self._clients[name].service_is_ready():
            self._asked.append((made, self._clients[name].call_async(made.request)))

    def refused(self) -> Counter[str]:
        """How many questions were refused, by service."""
        return Counter(_name(asked) for asked, told in self._asked if told.done() and asked.is_refused(told.result()))

    def findings(self) -> Iterator[str]:
        """A line for each question that was not answered, or not refused."""
        for asked, told in self._asked:
            if not told.done():
                yield f"{_name(asked)}: no answer to {_text(asked.request)}"
            elif not asked.is_refused(told.result()):
                yield f"{_name(asked)}: takes {_text(asked.request)}"


def _name(asked: Question) -> str:
    return f"{asked.node}/{asked.service}"


def _text(request: Any) -> str:
    return str(request)[:200]
