"""Nodes on a flight: all six of odometry and the points of detections reach the belief as in the offline pipeline."""

import json
from pathlib import Path

import numpy as np
import pytest
from semantic_slam_lab.simulation.tables import Flight, table_tops
from worlds.node_runs import Replay, assert_same, beliefs, run
from worlds.table_bag import in_space, table_entries, write_table_bag

from semantic_slam.configuration import to_dict
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.pipeline.offline import run_bag

pytestmark = [pytest.mark.ros, pytest.mark.slow]


def test_nodes_in_space_give_the_beliefs_of_the_offline_pipeline(tmp_path: Path) -> None:
    own = in_space()
    room = table_tops(Flight(keyframes=8, things=6), SpatialRegion.of(own.open_world), np.random.default_rng(5))
    bag = write_table_bag(tmp_path / "bag", table_entries(room))
    run_bag(bag, tmp_path / "offline", own)
    configuration = tmp_path / "spatial.yaml"
    configuration.write_text(json.dumps(to_dict(own)))
    reference = beliefs(tmp_path / "offline")
    assert reference[-1].state_space == "spatial" and len(reference) == 8
    assert_same(run(Replay(bag, configuration, tmp_path / "live", backends=2)), reference)
