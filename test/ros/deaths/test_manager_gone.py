"""A replay whose manager ends says so, and does not end as if all were well."""

import os
import signal
import sys
import time
from pathlib import Path

import pytest
from worlds.bags.bag_factory import write_bag, write_configuration
from worlds.bags.places import place_entries
from worlds.processes.node_runs import TIMEOUT_S, processes

from semantic_slam.errors import SemanticSlamError
from semantic_slam.ros.launching.node_set import RunOptions, node_set

PLAYER = "from semantic_slam.ros import bag_player; bag_player.GONE_S = 2.0; bag_player.main()"
"""As it is, but for half a minute that it waits for another manager."""


@pytest.mark.long
@pytest.mark.ros
@pytest.mark.slow
def test_the_player_ends_with_one_line_when_the_manager_is_gone(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", place_entries("ranges", num_frames=12))
    configuration = write_configuration(tmp_path / "configuration")
    specs = {
        spec.name: spec for spec in node_set(bag, configuration, 0.0, RunOptions(), has_tf2=False, has_stereo=True)
    }
    del specs["backend_0"]  # so that the manager never comes to an end
    with processes(tmp_path) as nodes:
        for spec in specs.values():
            nodes.start(spec, [sys.executable, "-c", PLAYER] if spec.name == "bag_player" else ())
        give_up = time.monotonic() + TIMEOUT_S
        while "/12" not in nodes.tail("bag_player") and time.monotonic() < give_up:
            time.sleep(0.1)
        time.sleep(1.0)
        # One that is killed leaves its publishers in the graph for 20 s; the player then does the same.
        os.kill(nodes.pids()["hypothesis_manager"], signal.SIGTERM)
        while nodes.exit_code("bag_player") is None and time.monotonic() < give_up:
            time.sleep(0.1)
        assert nodes.exit_code("bag_player") == 2
        said = nodes.tail("bag_player")
        with pytest.raises(SemanticSlamError):
            nodes.check()
    assert "hypothesis_manager is gone; 0 of" in said and "Traceback" not in said
