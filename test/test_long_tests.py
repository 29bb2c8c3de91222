"""The shares of the long tests: together they are all, and none has a test twice."""

from argparse import ArgumentTypeError
from itertools import chain

import pytest
from long_tests import Share

TESTS = [f"test/inference/test_{number // 5}.py::test_{number}" for number in range(200)]


def test_every_test_is_in_one_of_the_shares() -> None:
    shares = [Share.of(f"{number}/4") for number in (1, 2, 3, 4)]
    members = [[name for name in TESTS if share.has(name)] for share in shares]
    assert sorted(chain(*members)) == sorted(TESTS)
    assert min(len(names) for names in members) > 25


def test_all_are_run_or_none() -> None:
    assert all(Share.of("all").has(name) for name in TESTS)
    assert not any(Share.of("none").has(name) for name in TESTS)


@pytest.mark.parametrize("text", ["", "0/4", "5/4", "2", "a/b", "1/2/3"])
def test_what_is_no_share_is_refused(text: str) -> None:
    with pytest.raises(ArgumentTypeError, match="give none, all"):
        Share.of(text)
