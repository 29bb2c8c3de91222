"""What killed recorders left of a bag begins the bag of the next one, and nothing of it is lost on the way."""

from pathlib import Path

import pytest
from worlds.belief_factory import small_belief

from semantic_slam.bag.continuation import Continuation, unfinished_bag
from semantic_slam.bag.reader import BagReader
from semantic_slam.bag.writer import BagWriter
from semantic_slam.messages import topics
from semantic_slam.outputs import claimed_again


def written(place: Path, keyframes: range) -> None:
    """A bag whose recorder was killed: what was flushed is there, and half a chunk more."""
    writer = BagWriter(place)
    writer.__enter__()
    for k in keyframes:
        writer.write(topics.BELIEF, small_belief(k, [1], [1], [1.0], [4], [[4]]), 1 + k)
    writer.flush()
    (storage,) = place.glob("*.mcap")
    storage.write_bytes(storage.read_bytes() + b"\x06\x40\x00\x00\x00\x00\x00\x00\x00half")


def keyframes_of(continuation: Continuation) -> list[int]:
    return [message.stamp_ns - 1 for message, _ in continuation.messages()]


def test_a_whole_bag_or_none_is_not_gone_on_with(tmp_path: Path) -> None:
    assert unfinished_bag(tmp_path / "bag") is None
    with BagWriter(tmp_path / "bag") as writer:
        writer.write(topics.BELIEF, small_belief(0, [1], [1], [1.0], [4], [[4]]), 1)
    assert unfinished_bag(tmp_path / "bag") is None


def test_what_a_killed_recorder_left_is_taken_over(tmp_path: Path) -> None:
    place = tmp_path / "bag"
    written(place, range(3))
    assert unfinished_bag(place) == place
    continuation = Continuation(place)
    assert not place.exists() and keyframes_of(continuation) == [0, 1, 2]
    with BagWriter(place) as writer:
        for message, definition in continuation.messages():
            writer.write_raw(message.topic, message.type_name, message.cdr, message.stamp_ns, definition)
        assert continuation.done(place) == []
    with BagReader(place) as reader:
        assert not reader.unfinished and reader.num_messages == 3
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]


def test_a_damaged_part_is_kept_and_named(tmp_path: Path) -> None:
    """A flipped bit in the third of five keyframes: what comes after it is in no other bag."""
    place = tmp_path / "bag"
    writer = BagWriter(place)
    writer.__enter__()
    for k in range(5):
        writer.write(topics.BELIEF, small_belief(k, [1], [1], [1.0], [4], [[4]]), 1 + k)
        writer.flush()
    (storage,) = place.glob("*.mcap")
    data = bytearray(storage.read_bytes())
    data[len(data) // 2] ^= 4
    storage.write_bytes(data)
    continuation = Continuation(place)
    found = keyframes_of(continuation)
    assert found == list(range(len(found))) and 0 < len(found) < 5
    (line,) = continuation.done(place)
    kept = tmp_path / "bag.damaged_000"
    assert line.startswith(f"{kept}: damaged (bag.mcap: the chunk at byte ") and "\n" not in line
    assert (kept / "bag.mcap").read_bytes() == data and [path.name for path in tmp_path.iterdir()] == [kept.name]


def test_a_second_death_while_taking_over_loses_nothing(tmp_path: Path) -> None:
    """Killed after it moved the bag, and again after it had begun to copy."""
    place = tmp_path / "bag"
    written(place, range(3))
    Continuation(place)
    assert unfinished_bag(place) == place
    assert keyframes_of(Continuation(place)) == [0, 1, 2]
    written(place, range(2))
    assert keyframes_of(Continuation(unfinished_bag(place) or tmp_path)) == [0, 1, 2]


@pytest.mark.parametrize(
    ("parts", "taken"),
    [
        ([range(5), range(2), range(3)], [0, 1, 2, 3, 4]),  # killed twice while it copied
        ([range(2), range(5)], [0, 1, 2, 3, 4]),  # killed after it had copied everything, and gone on
        ([range(3), range(3)], [0, 1, 2]),
        ([range(3), range(1, 4)], [0, 1, 2, 1, 2, 3]),  # neither is in the other
    ],
)
def test_a_part_that_is_in_another_one_is_taken_over_once(parts: list[range], taken: list[int], tmp_path: Path) -> None:
    """However long it is: what is remembered of single messages is bounded."""
    for part in parts:
        written(tmp_path / "bag", part)
        continuation = Continuation(tmp_path / "bag")
    assert keyframes_of(continuation) == taken
    assert continuation.done(tmp_path / "bag") == [] and list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("has_old", [False, True])
def test_the_bag_takes_the_place_of_an_old_one_at_the_end(tmp_path: Path, has_old: bool) -> None:
    place = tmp_path / "bag"
    staged = tmp_path / "bag.unfinished_x" / "bag" if has_old else place
    if has_old:
        with BagWriter(place) as writer:
            writer.write(topics.BELIEF, small_belief(9, [1], [1], [1.0], [4], [[4]]), 9)
        staged.parent.mkdir()
    written(staged, range(3))
    assert unfinished_bag(place) == staged
    with claimed_again(place, staged) as where:
        assert keyframes_of(Continuation(where)) == [0, 1, 2]
        with BagWriter(where) as writer:
            writer.write(topics.BELIEF, small_belief(7, [1], [1], [1.0], [4], [[4]]), 7)
    with BagReader(place) as reader:
        assert [message.stamp_ns for message in reader.messages()] == [7]
