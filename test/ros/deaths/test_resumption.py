"""Where a player begins that was started again, and which messages the other nodes know."""

from collections import Counter

import pytest
from worlds.bags.bag_factory import input_entries, of_topic

from semantic_slam.bag.mcap_stream import RawMessage
from semantic_slam.messages import topics
from semantic_slam.messages.standard import header_stamp_ns as stamp_of
from semantic_slam.messages.topics import CLASSIFIER_PROGRESS
from semantic_slam.messages.typestore import serialize
from semantic_slam.ros.node.repeats import MOST_NEWS, MOST_REMEMBERED, Repeats
from semantic_slam.ros.replay.resumption import FROM_THE_START, MARGIN, header_stamp_ns, resumption

NUM_FRAMES = 14


@pytest.fixture(scope="module")
def frames() -> list[RawMessage]:
    entries = of_topic(input_entries(NUM_FRAMES), topics.DETECTIONS)
    return [RawMessage("/detections", "", 100 + n, serialize(entry.message)) for n, entry in enumerate(entries)]


def test_the_stamp_of_a_header_is_read_from_its_bytes(frames: list[RawMessage]) -> None:
    for raw, entry in zip(frames, of_topic(input_entries(NUM_FRAMES), topics.DETECTIONS), strict=True):
        assert header_stamp_ns(raw.cdr) == stamp_of(entry.message)
    assert header_stamp_ns(b"\x00\x01") == 0


def test_a_replay_goes_on_some_frames_before_the_newest_one_done_with(frames: list[RawMessage]) -> None:
    newest = MARGIN + 3
    start = resumption(frames, header_stamp_ns(frames[newest].cdr))
    assert start.frame == 3 and start.log_time_ns == frames[2].stamp_ns
    assert not start.takes(frames[2], 2) and start.takes(frames[3], 3)
    assert start.takes(frames[2], None) and not start.takes(frames[1], None)  # pictures of the first frame


def test_a_replay_begins_at_its_start_where_little_or_nothing_is_done(frames: list[RawMessage]) -> None:
    assert resumption(frames, header_stamp_ns(frames[MARGIN].cdr)) == FROM_THE_START
    assert resumption(frames, 12345) == FROM_THE_START


def test_repeated_messages_are_known_by_topic_and_content() -> None:
    counted: Counter[str] = Counter()
    repeats = Repeats(counted)
    assert not repeats.is_known("odom", b"a") and repeats.is_known("odom", b"a")
    assert not repeats.is_known("image", b"a") and not repeats.is_known("odom", b"b")
    assert counted == {"odom": 1}


def test_what_was_not_used_may_come_again() -> None:
    repeats = Repeats(Counter())
    repeats.is_known("belief", b"a")
    repeats.forget("belief", b"a")
    repeats.forget("belief", b"b")
    repeats.forget("odom", b"a")
    assert not repeats.is_known("belief", b"a") and repeats.is_known("belief", b"a")


def test_what_is_remembered_is_bounded() -> None:
    """News of how far a node is, which come with every frame of a live drive, less far back."""
    repeats = Repeats(Counter())
    for topic, most in (("odom", MOST_REMEMBERED), (CLASSIFIER_PROGRESS, MOST_NEWS)):
        for n in range(most + 1):
            repeats.is_known(topic, n.to_bytes(4, "little"))
        assert repeats.is_known(topic, (1).to_bytes(4, "little"))
        assert not repeats.is_known(topic, (0).to_bytes(4, "little"))
