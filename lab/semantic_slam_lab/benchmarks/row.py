"""One figure of the benchmark."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Row:
    """A ratio, and what it was made of."""

    name: str
    ours: float
    peer: float
    unit: str
    ratio: float
    n: int  # repetitions
    how: str


def alternated(ours: Callable[[], Any], peer: Callable[[], Any], repetitions: int) -> tuple[float, float]:
    """Median CPU seconds of this thread for each, called in turn so that both meet the same machine."""
    times = np.array([[cpu_seconds(ours), cpu_seconds(peer)] for _ in range(repetitions)])
    first, second = np.median(times, axis=0)
    return float(first), float(second)


def cpu_seconds(call: Callable[[], Any]) -> float:
    """CPU seconds of this thread in a call."""
    start = time.thread_time()
    call()
    return time.thread_time() - start
