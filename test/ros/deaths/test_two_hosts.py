"""A backend on a second host joins, dies, is started again and joins again, and the beliefs are those of one host."""

import sys
from pathlib import Path

import pytest
from worlds.bags.bag_factory import map_prior, write_bag, write_configuration
from worlds.bags.places import place_entries
from worlds.processes.node_runs import TIMEOUT_S, Replay, assert_same, beliefs, processes
from worlds.processes.two_hosts import two_hosts

from semantic_slam.configuration import load_configuration
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.ros.launching.supervisor import Supervisor

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.two_hosts]

NUM_FRAMES = 30
"""So many that a backend on the robot, which takes its time, is not done before the other one is back."""
FAULTY = Path(__file__).parents[1] / "faulty_backends.py"
SLOW = [sys.executable, str(FAULTY), "slow"]
DIES_ONCE = """
if [ -e {mark} ]; then
    until grep -q "backend_1 is gone" {log}; do sleep 0.1; done
    exec backend_node "$@"
fi
touch {mark}
exec {python} {faulty} dying "$@"
"""
"""Not back before it is missed: a fast machine starts it within its lease, and then nobody notices."""
MOST_BYTES = 200_000
"""For a keyframe of two objects, and its share of what discovery takes."""


@pytest.mark.long
def test_a_backend_on_another_host_dies_and_joins_again(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", place_entries("ranges", NUM_FRAMES))
    (bag / "objects.json").write_text(map_prior().to_json())
    lost = {"mean": [0.0, 0.0, 0.0], "sigma": [2.0, 2.0, 0.5]}
    limits = {"ratio": 1e6, "max_hypotheses": 8}
    configuration = write_configuration(tmp_path, initial_pose=lost, pruning=limits)
    run_bag(bag, tmp_path / "reference", load_configuration(configuration))
    replay = Replay(bag, configuration, tmp_path / "live", 2)
    log = replay.out / "log" / "hypothesis_manager.log"
    dies_once = DIES_ONCE.format(mark=tmp_path / "mark", log=log, python=sys.executable, faulty=FAULTY)
    with two_hosts() as (robot, other):
        specs = replay.specs()
        with processes(replay.out, Supervisor(specs, last="bag_recorder")) as nodes:
            commands = {
                "backend_0": robot.command(SLOW),
                "backend_1": other.command(["bash", "-c", dies_once, "backend_1"]),
            }
            for spec in specs:
                nodes.start(spec, commands.get(spec.name, robot.command([spec.executable])))
            nodes.wait("bag_recorder", TIMEOUT_S)
            sent = robot.sent_bytes() / NUM_FRAMES, other.sent_bytes() / NUM_FRAMES
    live = beliefs(replay.belief_bag)
    assert_same(live, beliefs(tmp_path / "reference"))
    assert max(len(belief.hypothesis_ids) for belief in live) >= 2
    said = replay.output_of("hypothesis_manager")
    assert "backend_1 is gone" in said and "backend_1 is back" in said
    print("sent for a keyframe, bytes:", sent)
    assert min(sent) > 0.0 and max(sent) < MOST_BYTES
