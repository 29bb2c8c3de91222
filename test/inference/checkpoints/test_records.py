"""Containers and lineages come back as they were; steps that lineages share are written once."""

from array import array
from collections import Counter, OrderedDict, deque
from typing import Any

import pytest

from semantic_slam.inference.checkpoints.records import packed, unpacked
from semantic_slam.inference.states.lineage import Lineage, LineageStep

VALUES: tuple[Any, ...] = (
    deque([1.5, None], maxlen=4),
    deque(["a"]),
    Counter({"a": 2, "gone": 0}),
    OrderedDict([(7, 1), (3, 2)]),
    {3, 1, 2},
    array("q", [2**40, -1]),
    array("d", [0.1, float("inf")]),
    b"\x00\xff bytes",
    b"",
    [("nested", {"of": frozenset({1})})],
)


@pytest.mark.parametrize("value", VALUES, ids=lambda value: type(value).__name__)
def test_a_container_comes_back_with_its_kind_and_its_order(value: Any) -> None:
    again = unpacked(packed(value))
    assert again == value and type(again) is type(value) and list(again) == list(value)
    assert getattr(again, "maxlen", None) == getattr(value, "maxlen", None)


def test_equal_sets_are_equal_bytes_whatever_their_history() -> None:
    words = [f"label {n}" for n in range(50)]
    assert packed(set(words)) == packed(set(reversed(words))) and packed(frozenset(words)) == packed(frozenset(words))


def steps(count: int) -> Lineage:
    return tuple(
        LineageStep.of((n, -1), (n % 3, -1), mode=n, changes=((n - 1, 0, 5, n - 1),) if n % 4 == 1 else ())
        for n in range(count)
    )


def test_lineages_come_back_and_share_their_steps() -> None:
    common = steps(40)
    one, other = (*common, LineageStep.of((7,), (0,))), (*common, LineageStep.of((), ()))
    again = unpacked(packed({"one": one, "other": other, "none": ()}))
    assert again == {"one": one, "other": other, "none": ()}
    assert all(a is b for a, b in zip(again["one"][:40], again["other"], strict=False))


def test_another_hypothesis_costs_only_the_rows_of_its_lineage() -> None:
    """Four bytes for each step of another lineage; none where it is the same one."""
    common = steps(400)
    lineages = [(*common, LineageStep.of((n,), (0,))) for n in range(3)]
    sizes = [len(packed(told)) for told in (lineages[:2], lineages, [*lineages, lineages[0]])]
    assert sizes[1] - sizes[0] < 4 * 401 + 100
    assert sizes[2] - sizes[1] < 4 * 401 + 60
