"""Nodes on a bag without pictures: the classifier passes places on, in lock-step with the others."""

from pathlib import Path

import pytest
from worlds.bag_factory import write_bag, write_configuration
from worlds.node_runs import Replay, assert_same, beliefs, run
from worlds.places import place_entries

from semantic_slam.configuration import load_configuration
from semantic_slam.pipeline.offline import run_bag

pytestmark = [pytest.mark.ros, pytest.mark.slow]

NUM_FRAMES = 10


def test_places_give_the_beliefs_of_the_offline_pipeline_without_a_network(tmp_path: Path) -> None:
    nowhere = {"network": "nowhere.safetensors"}
    configuration = write_configuration(tmp_path / "configuration", perception=nowhere)
    bag = write_bag(tmp_path / "bag", place_entries("ranges", NUM_FRAMES))
    run_bag(bag, tmp_path / "offline", load_configuration(configuration))
    reference = beliefs(tmp_path / "offline")
    assert len(reference) == NUM_FRAMES
    assert_same(run(Replay(bag, configuration, tmp_path / "live", backends=1)), reference)
