"""Replays begin where histories part, from few components that are kept along the one before."""

from itertools import pairwise

from semantic_slam.inference.revision.replay import CHECKPOINT, CLOSE, stays


def kept_at(now: int) -> list[int]:
    """Which components a replay of so many keyframes leaves, when there is a look every ten."""
    kept: list[int] = []
    for length in range(CHECKPOINT, now + 1, CHECKPOINT):
        kept = [at for at in [*kept, length] if stays(at, length)]
    return kept


def test_what_is_kept_grows_with_the_logarithm_of_the_drive() -> None:
    counts = [len(kept_at(CHECKPOINT * 2**power)) for power in range(4, 10)]
    assert max(b - a for a, b in pairwise(counts)) <= CLOSE
    assert counts[-1] <= CLOSE * 8


def test_a_history_is_replayed_from_at_most_twice_as_long_ago_as_it_parts() -> None:
    now = 1000
    kept = kept_at(now)
    for parts in range(CHECKPOINT, now):
        begin = max((at for at in kept if at <= parts), default=0)
        assert now - begin <= max(2 * (now - parts), now - parts + CHECKPOINT)
