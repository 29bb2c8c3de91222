"""A manager whose robot may be carried on its map: its journal is begun anew, too, but not while it is looked for."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from semantic_slam_lab.soak.journaled_manager import Event, LivingPool, Manager, events_of
from worlds.same_beliefs import assert_same
from worlds.scenes.lost_world import carried_world, configuration, errors, map_of

from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.checkpoints.records import packed

START, THERE = np.array([4.0, -7.0, 1.9]), np.array([-1.0, -3.0, 0.4])
HORIZON = 40
KILLED_AT, CARRIED_AT, END = 84, 3 * HORIZON - 2, 3 * HORIZON + 12
"""Keyframes: the third snapshot is due shortly after the robot is carried."""
WORLD = carried_world(START, THERE, CARRIED_AT, END - CARRIED_AT)
SETTINGS = configuration(
    history={"horizon_keyframes": HORIZON},
    initial_pose={"mean": START.tolist(), "sigma": [0.01, 0.01, 0.01]},
    keyframes={"policy": "every_detection"},
    odometry={"sigma_translation_per_m": 0.05, "sigma_rotation_per_m": 0.02, "sigma_rotation_per_rad": 0.05},
    pruning={"max_hypotheses": 3},
    revision={"carried_probability": 1e-3, "carried_m": 5.0},
)
EVENTS = list(events_of(WORLD.keyframes))
BEFORE_KILLED = KILLED_AT * len(EVENTS) // END


def bytes_of(folder: Path) -> int:
    """Of the journal, without the keyframes that are kept beside it."""
    return sum(path.stat().st_size for path in folder.iterdir() if path.name.startswith("journal"))


def handled(manager: Manager, events: list[Event]) -> tuple[list[int], list[int]]:
    """Numbers of keyframes after which snapshots were taken, and at which the robot was being looked for."""
    taken, looking = [], []
    for event in events:
        since = manager.snapshots._since
        manager.receive(event)
        if manager.snapshots._since < since:
            taken.append(manager.session.num_keyframes)
        if manager.session.num_keyframes and not manager.session.may_be_stored:
            looking.append(manager.session.num_keyframes)
    return taken, looking


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[int, HybridBelief], int]:
    """Beliefs of a run without snapshots, and the bytes of its journal."""
    folder = tmp_path_factory.mktemp("whole")
    manager = Manager(folder, SETTINGS, map_prior=map_of(), snapshots=False)
    for event in EVENTS:
        manager.receive(event)
    manager.close()
    return manager.beliefs, bytes_of(folder)


@pytest.mark.long
def test_it_goes_on_from_a_snapshot_and_finds_its_robot_as_if_it_had_never_been_killed(
    undisturbed: tuple[dict[int, HybridBelief], int], tmp_path: Path
) -> None:
    expected, whole = undisturbed
    folder = tmp_path / "own"
    killed = Manager(folder, SETTINGS, map_prior=map_of())
    taken, looking = handled(killed, EVENTS[:BEFORE_KILLED])
    assert taken == [HORIZON, 2 * HORIZON] and not looking
    killed.close()
    manager = Manager(folder, SETTINGS, LivingPool(killed.pool), map_prior=map_of())
    taken, looking = handled(manager, EVENTS[BEFORE_KILLED:])
    assert min(looking) <= 3 * HORIZON and taken == [max(looking) + 1]  # it waits until the robot is found
    manager.close()
    again = Manager(shutil.copytree(folder, tmp_path / "copy"), SETTINGS, LivingPool(manager.pool), map_prior=map_of())
    for made, first in ((killed, 0), (manager, HORIZON), (again, 2 * HORIZON)):
        assert min(made.beliefs) == first
        for keyframe, belief in made.beliefs.items():
            assert_same(belief, expected[keyframe])
    last = again.beliefs[END - 1]
    assert np.exp(last.log_weights[errors(last, WORLD.truth[-1]) < 0.3]).sum() > 0.9
    assert packed(again.session.state()) == packed(manager.session.state())
    assert bytes_of(folder) < whole
