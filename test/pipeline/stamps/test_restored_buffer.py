"""A buffer with the state of another one goes on as that one does, also with items on hold or refused."""

from collections import Counter

import pytest

from semantic_slam.inference.checkpoints.records import packed, unpacked
from semantic_slam.pipeline.stamps.stamped_buffer import StampedBuffer
from semantic_slam.state import restore, state_of

STAMPS = (10, 20, 30, 40, 500, 510, 50, 60, 61, 900, 910, 920, 3, 4, 5, 930)
"""Two that leap ahead and are refuted, a gap that is confirmed, and three of another session."""


def filled(buffer: StampedBuffer[str], stamps: tuple[int, ...]) -> StampedBuffer[str]:
    for stamp in stamps:
        buffer.add(stamp, f"item {stamp}")
    return buffer


@pytest.mark.parametrize("at", range(len(STAMPS)))
def test_a_restored_buffer_goes_on_at_any_stamp(at: int) -> None:
    dropped, again_dropped = Counter[str](), Counter[str]()
    first, again = StampedBuffer[str]("topic", dropped), StampedBuffer[str]("topic", again_dropped)
    filled(first, STAMPS[:at])
    restore(again, unpacked(packed(state_of(first))))
    again_dropped.update(dropped)
    filled(first, STAMPS[at:])
    filled(again, STAMPS[at:])
    assert packed(state_of(again)) == packed(state_of(first))
    assert list(again) == list(first) and again_dropped == dropped
    assert again.is_set_back == first.is_set_back
