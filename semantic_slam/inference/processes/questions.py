"""What a pool asks of a backend in another process, and what that answers."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Question:
    """A call of a method of a backend."""

    name: str
    argument: Any


@dataclass(frozen=True)
class Answer:
    """What the method returned or raised."""

    value: Any
    cpu_s: float  # CPU time that it took
    fault: Exception | None = None
