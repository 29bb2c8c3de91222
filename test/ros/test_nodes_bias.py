"""Nodes that estimate what odometry always gets wrong: how it changes the motion travels with the keyframe."""

from pathlib import Path

import pytest
import yaml
from worlds.node_runs import Replay, beliefs, run
from worlds.same_beliefs import assert_same

from semantic_slam.configuration import load_configuration
from semantic_slam.datasets.victoria_park import example_path, read_log
from semantic_slam.datasets.victoria_park_import import write_bag
from semantic_slam.pipeline.offline import run_bag

NUM_KEYFRAMES = 20
PARAMETERS = {
    "association": "open",
    "semantic_model": {"kind": "none"},
    "open_world": {"iterate_updates": False, "min_range_m": 4.0, "max_range_m": 21.0, "field_of_view_rad": 3.1416},
    "odometry": {"estimate_bias": True, "sigma_clock_offset_s": 0.1},
    "initial_pose": {"mean": [0.0, 0.0, 0.0], "sigma": [0.01, 0.01, 0.001]},
    "pruning": {"max_hypotheses": 4},
}


@pytest.mark.slow
def test_nodes_and_offline_agree_on_a_drive_whose_odometry_is_biased(tmp_path: Path) -> None:
    """Several odometry samples lie between its keyframes, which are not one arc together."""
    bag, configuration = tmp_path / "bag", tmp_path / "configuration.yaml"
    write_bag(read_log(example_path()), bag, 0.4, max_keyframes=NUM_KEYFRAMES)
    configuration.write_text(yaml.safe_dump({"/**": {"ros__parameters": PARAMETERS}}))
    run_bag(bag, tmp_path / "offline", load_configuration(configuration))
    live, offline = run(Replay(bag, configuration, tmp_path / "live", backends=2)), beliefs(tmp_path / "offline")
    assert len(live) == len(offline) == NUM_KEYFRAMES
    assert max(len(belief.hypothesis_ids) for belief in offline) > 1
    for ours, theirs in zip(live, offline, strict=True):
        assert_same(ours, theirs)
