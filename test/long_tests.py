"""Tests marked ``long`` are left out unless ``--long`` asks for them: all, or the K-th of N shares of them."""

import re
import zlib
from argparse import ArgumentTypeError
from dataclasses import dataclass
from typing import Self

import pytest

MARKER = "long"


@dataclass(frozen=True)
class Share:
    """The ``number``-th of ``count`` shares, which number from 1; 0 of 1: none."""

    number: int
    count: int

    @classmethod
    def of(cls, text: str) -> Self:
        """From "none", "all" or "K/N". Raises argparse.ArgumentTypeError."""
        if text in ("none", "all"):
            return cls(int(text == "all"), 1)
        numbers = re.fullmatch(r"([1-9]\d*)/([1-9]\d*)", text)
        if numbers is None or int(numbers[1]) > int(numbers[2]):
            raise ArgumentTypeError(f"'{text}' is no share; give none, all, or one such as 2/4")
        return cls(int(numbers[1]), int(numbers[2]))

    def has(self, name: str) -> bool:
        """Whether the cases of a test function belong to it, by its node id without parameters."""
        return self.number > 0 and zlib.crc32(name.encode()) % self.count == self.number - 1


def add_option(parser: pytest.Parser) -> None:
    """``--long``."""
    parser.addoption(
        "--long",
        type=lambda text: Share.of(text) and text,  # as text, which pytest-xdist can send to its workers
        default="none",
        metavar="none|all|K/N",
        help="long tests to run (default: %(default)s)",
    )


def leave_out(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Deselect the long tests that nobody asked for."""
    share = Share.of(str(config.getoption("long")))
    kept, left = [], []
    for item in items:
        runs = item.get_closest_marker(MARKER) is None or share.has(item.nodeid.partition("[")[0])
        (kept if runs else left).append(item)
    if left:
        config.hook.pytest_deselected(items=left)
        items[:] = kept
