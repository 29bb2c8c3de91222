"""The state of an object is what it learned, and makes another one of the same parameters its equal."""

from collections import Counter
from typing import ClassVar

import pytest

from semantic_slam.state import restore, state_of


class Part:
    STATE: ClassVar[tuple[str, ...]] = ("count",)

    def __init__(self, counted: Counter[str]) -> None:
        self.count, self.counted = 0, counted

    def learn(self) -> None:
        self.count += 1
        self.counted["learnt"] += 1


class Whole:
    STATE: ClassVar[tuple[str, ...]] = ("counted", "part", "last", "missing")

    def __init__(self, parameter: float) -> None:
        self.parameter, self.counted, self.last, self.missing = parameter, Counter[str](), 0.0, None
        self.part = Part(self.counted)

    def learn(self) -> None:
        self.part.learn()
        self.last += self.parameter


def test_a_restored_object_goes_on_as_the_other_one() -> None:
    one, other = Whole(2.0), Whole(2.0)
    for _ in range(3):
        one.learn()
    state = state_of(one)
    assert state == {"counted": {"learnt": 3}, "part": {"count": 3}, "last": 6.0, "missing": None}
    part = other.part
    restore(other, state)
    one.learn()
    other.learn()
    assert state_of(other) == state_of(one) and other.part is part


def test_a_part_counts_into_the_restored_counter_of_the_whole() -> None:
    one, other = Whole(1.0), Whole(1.0)
    one.learn()
    restore(other, state_of(one))
    other.learn()
    assert other.counted == {"learnt": 2} and one.counted == {"learnt": 1}


def test_a_state_of_another_class_is_refused() -> None:
    whole = Whole(1.0)
    with pytest.raises(ValueError, match="no state of Whole"):
        restore(whole, state_of(whole.part))
    with pytest.raises(ValueError, match="no state of Part"):
        restore(whole, {**state_of(whole), "part": {}})
    with pytest.raises(ValueError, match="no state of float"):
        restore(1.0, {})
