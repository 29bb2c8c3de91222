"""Nodes on a flight: odometry's six, points and gravity reach the belief as in the offline pipeline."""

import json
from pathlib import Path

import numpy as np
import pytest
from semantic_slam_lab.simulation.detectors.inertial import Imu
from semantic_slam_lab.simulation.tables import T_BODY_CAMERA, Flight, table_tops
from worlds.imported import read_bag
from worlds.node_runs import Replay, assert_same, beliefs, run
from worlds.table_bag import in_space, with_imu, write_table_bag

from semantic_slam.configuration import to_dict
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.pipeline.offline import run_bag

pytestmark = [pytest.mark.ros, pytest.mark.slow]


def test_nodes_in_space_give_the_beliefs_of_the_offline_pipeline(tmp_path: Path) -> None:
    own = in_space()
    room = table_tops(Flight(keyframes=8, things=6), SpatialRegion.of(own.open_world), np.random.default_rng(5))
    entries = with_imu(room, Imu(T_body_imu=T_BODY_CAMERA), np.random.default_rng(5))
    bag = write_table_bag(tmp_path / "bag", entries)
    run_bag(bag, tmp_path / "offline", own)
    configuration = tmp_path / "spatial.yaml"
    configuration.write_text(json.dumps(to_dict(own)))
    reference = beliefs(tmp_path / "offline")
    assert reference[-1].state_space == "spatial" and len(reference) == 8
    assert_same(run(Replay(bag, configuration, tmp_path / "live", backends=2)), reference)
    recorded = [len(read_bag(folder)["/imu"]) for folder in (tmp_path / "offline", tmp_path / "live" / "belief")]
    assert recorded[0] == recorded[1] == sum(entry.topic == "imu" for entry in entries)
