"""Places of a frame that is not the body's: nodes drop the messages that a run of the bag drops, and wait for none."""

from pathlib import Path

import pytest
from worlds.bags.bag_factory import of_topic, write_bag, write_configuration
from worlds.bags.mistakes import of_lidar
from worlds.bags.places import place_entries
from worlds.processes.node_runs import Replay, assert_same, beliefs, run

from semantic_slam.configuration import load_configuration
from semantic_slam.messages import topics
from semantic_slam.pipeline.offline import run_bag

pytestmark = [pytest.mark.ros, pytest.mark.slow]

NUM_FRAMES, ELSEWHERE = 6, (1, 2, 5)


@pytest.mark.long
def test_a_replay_goes_on_past_places_that_are_dropped(tmp_path: Path) -> None:
    configuration, entries = write_configuration(tmp_path / "configuration"), place_entries("ranges", NUM_FRAMES)
    for k in ELSEWHERE:
        of_lidar(of_topic(entries, topics.DETECTIONS)[k].message)
    bag = write_bag(tmp_path / "bag", entries)
    summary = run_bag(bag, tmp_path / "offline", load_configuration(configuration))
    assert list(summary.dropped.values()) == [len(ELSEWHERE)]
    found = run(Replay(bag, configuration, tmp_path / "nodes", backends=1))
    assert len(found) == NUM_FRAMES - len(ELSEWHERE)
    assert_same(found, beliefs(tmp_path / "offline"))
