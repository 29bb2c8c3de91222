"""What is forged is refused: each kind of each topic by whoever reads it, as far as one message tells."""

import numpy as np
import pytest
from semantic_slam_lab.fuzz.forgery import KINDS, again, cut, forgery, garbage, of_another_run, out_of_turn, unequal
from semantic_slam_lab.fuzz.protocol import spoken

from semantic_slam.errors import MessageError
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message
from semantic_slam.messages.typestore import deserialize, serialize

TOPICS = {topics.TYPES[topic]: topic for topic in (topics.RUN_CONFIGURATION, topics.KEYFRAMES, topics.COMMITS)}


@pytest.fixture(scope="module")
def genuine() -> dict[str, bytes]:
    """A message of each topic on which a manager speaks to backends."""
    return {TOPICS[message.__msgtype__]: serialize(message) for message in spoken()}


@pytest.mark.parametrize("seed", range(20))
def test_garbage_and_what_is_cut_off_do_not_decode(genuine: dict[str, bytes], seed: int) -> None:
    for topic, data in genuine.items():
        for kind in (garbage, cut):
            with pytest.raises(MessageError, match="do not decode"):
                deserialize(kind(topic, data, np.random.default_rng(seed)), topics.TYPES[topic])


@pytest.mark.parametrize("seed", range(10))
def test_arrays_of_different_lengths_contradict_each_other(genuine: dict[str, bytes], seed: int) -> None:
    forged = unequal(topics.COMMITS, genuine[topics.COMMITS], np.random.default_rng(seed))
    assert forged is not None
    with pytest.raises(MessageError):
        from_message(deserialize(forged, topics.TYPES[topics.COMMITS]))


def test_a_forged_message_of_another_run_or_turn_is_whole(genuine: dict[str, bytes]) -> None:
    chance = np.random.default_rng(0)
    for topic, data in genuine.items():
        before = deserialize(data, topics.TYPES[topic])
        other = of_another_run(topic, data, chance)
        assert other is not None and deserialize(other, topics.TYPES[topic]).run_id != before.run_id
        later = out_of_turn(topic, data, chance)
        assert later is None or deserialize(later, topics.TYPES[topic]).keyframe > before.keyframe
    assert out_of_turn(topics.RUN_CONFIGURATION, genuine[topics.RUN_CONFIGURATION], chance) is None


def test_every_kind_is_drawn_and_without_a_message_to_forge_those_that_need_none(genuine: dict[str, bytes]) -> None:
    chance = np.random.default_rng(0)
    drawn = {forgery(topic, [data], chance).kind for topic, data in genuine.items() for _ in range(40)}
    assert drawn == set(KINDS) - {"boast"}
    assert {forgery(topics.PLAYER_PROGRESS, [], chance).kind for _ in range(20)} == {"garbage", "boast"}
    assert again(topics.COMMITS, b"x", chance) == b"x"
