"""Real nodes over DDS, of which one dies and one is slow, against the offline pipeline: nothing is lost."""

import re
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from worlds.bags.bag_factory import input_entries, map_prior, write_bag, write_configuration
from worlds.processes.node_runs import Replay, assert_same, beliefs, run

from semantic_slam.configuration import load_configuration
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.pipeline.offline import run_bag

pytestmark = [pytest.mark.ros, pytest.mark.slow]

NUM_FRAMES = 10
FAULTY_BACKENDS = [sys.executable, str(Path(__file__).parents[1] / "faulty_backends.py")]
EXPECTED_TO_DIE = [
    sys.executable,
    "-c",
    """
import signal, subprocess, sys
node = subprocess.Popen(sys.argv[1:])
signal.signal(signal.SIGINT, lambda *_: node.send_signal(signal.SIGINT))  # or it would outlive a test that fails
node.wait()
""",
]


@pytest.fixture(scope="module")
def configuration(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot lost by metres among few objects: several hypotheses live, and every backend gets some."""
    return write_configuration(
        tmp_path_factory.mktemp("configuration"),
        initial_pose={"mean": [0.0, 0.0, 0.0], "sigma": [2.0, 2.0, 0.5]},
        pruning={"ratio": 1e6, "max_hypotheses": 8},
        perception={"num_passes": 3},
    )


@pytest.fixture(scope="module")
def camera_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pair of boxes stands in three places of the map: where the robot is, nobody can tell."""
    bag = write_bag(tmp_path_factory.mktemp("camera") / "bag", input_entries(NUM_FRAMES))
    pair = map_prior().objects
    copies = [
        replace(box, object_id=box.object_id + 2 * n, pose=box.pose + np.array([0.0, shift_m, 0, 0, 0, 0, 0]))
        for n, shift_m in enumerate((0.0, 3.0, -3.0))
        for box in pair
    ]
    (bag / "objects.json").write_text(MapPrior(tuple(copies)).to_json())
    return bag


@pytest.fixture(scope="module")
def offline_bag(tmp_path_factory: pytest.TempPathFactory, camera_bag: Path, configuration: Path) -> Path:
    """The offline pipeline's belief bag; it holds the measurements, so that it can be replayed without a classifier."""
    bag = tmp_path_factory.mktemp("offline") / "belief"
    run_bag(camera_bag, bag, load_configuration(configuration))
    shutil.copy(camera_bag / "objects.json", bag)
    return bag


@pytest.fixture(scope="module")
def reference(offline_bag: Path) -> list[HybridBelief]:
    return beliefs(offline_bag)


@pytest.fixture(scope="module")
def faulty_replay(
    tmp_path_factory: pytest.TempPathFactory, offline_bag: Path, configuration: Path
) -> tuple[Replay, list[HybridBelief]]:
    """Three backends, one of them far slower than the bag; one is killed half-way."""
    faulty = {
        "backend_1": [*FAULTY_BACKENDS, "slow"],
        "backend_2": [*EXPECTED_TO_DIE, *FAULTY_BACKENDS, "dying"],
    }
    replay = Replay(offline_bag, configuration, tmp_path_factory.mktemp("faulty"), backends=3, commands=faulty)
    return replay, run(replay)


def test_reference_has_work_for_three_backends(reference: list[HybridBelief]) -> None:
    assert len(reference) == NUM_FRAMES
    assert max(len(belief.hypothesis_ids) for belief in reference) >= 3


def test_hypotheses_of_a_killed_backend_move_to_the_others(
    faulty_replay: tuple[Replay, list[HybridBelief]], reference: list[HybridBelief]
) -> None:
    """It is missed by its sign of life, long before its time to answer is over."""
    replay, live = faulty_replay
    assert_same(live, reference)
    killed = re.search(r"killed at ([\d.]+)", replay.output_of("backend_2"))
    missed = re.search(
        r"\[([\d.]+)\] \[hypothesis_manager\]: backend_2 is gone", replay.output_of("hypothesis_manager")
    )
    assert killed and missed
    print(f"missed after {float(missed[1]) - float(killed[1]):.2f} s")
    assert 0.0 < float(missed[1]) - float(killed[1]) < 10.0


def test_lossless_replay_with_a_slow_backend_loses_nothing(faulty_replay: tuple[Replay, list[HybridBelief]]) -> None:
    _, live = faulty_replay
    assert [belief.keyframe for belief in live] == list(range(NUM_FRAMES))
    assert live[-1].dropped == 0
