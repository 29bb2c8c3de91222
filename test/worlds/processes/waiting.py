"""Waiting for what other threads and processes do."""

import time
from collections.abc import Callable


def comes_true(condition: Callable[[], bool], timeout_s: float = 120.0) -> bool:
    """Whether the condition holds within a time."""
    give_up = time.monotonic() + timeout_s
    while not condition() and time.monotonic() < give_up:
        time.sleep(0.02)
    return condition()
