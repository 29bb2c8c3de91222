"""Nodes that are killed while ``ros2 launch`` runs them, where ROS 2 is whole: the beliefs are the same."""

from pathlib import Path

import pytest
from semantic_slam_lab.kills.comparison import TOLERANCE, largest_difference
from semantic_slam_lab.kills.demo import Demo
from semantic_slam_lab.kills.trials import run_killing
from worlds.processes.node_runs import beliefs

from semantic_slam.configuration import load_configuration
from semantic_slam.pipeline.offline import run_bag

pytestmark = [pytest.mark.ros_full, pytest.mark.ros, pytest.mark.slow]

ROOT = Path(__file__).parents[3]
NAMES = ("backend_0", "classifier", "bag_recorder", "backend_1", "hypothesis_manager", "bag_player")
KILLS = [(10 * (number + 1), name) for number, name in enumerate(NAMES)]
"""Each node once; at every tenth keyframe each: ``python -m semantic_slam_lab.kills --launch``."""


def test_a_launch_whose_nodes_are_killed_records_the_same_beliefs(tmp_path: Path) -> None:
    bag, configuration = ROOT / "bags" / "aliased_room", ROOT / "config" / "default.yaml"
    run_bag(bag, tmp_path / "offline", load_configuration(configuration))
    launched = Demo(bag, configuration, tmp_path / "launched", through_launch=True)
    missed = run_killing(launched, KILLS)
    assert len(missed) < len(KILLS), "no node was killed"
    assert largest_difference(launched.beliefs(), beliefs(tmp_path / "offline")) <= TOLERANCE
