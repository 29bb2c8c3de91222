"""A run with a horizon goes on from a snapshot and what came since, to the bit, whenever its manager was killed."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from semantic_slam_lab.soak.robots import robot
from semantic_slam_lab.soak.tour import Tour
from worlds.processes.journaled_manager import Event, KeepingPool, LivingPool, Manager, events_of
from worlds.same_beliefs import assert_same

from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.checkpoints.records import packed
from semantic_slam.pipeline.journal import journal as journal_module
from semantic_slam.pipeline.journal.journal import FILE, NEW_FILE, NEXT_FILE
from semantic_slam.pipeline.journal.segment import Segment

HORIZON, NUM_KEYFRAMES = 20, 75
EVENTS_EACH = 3


class KilledError(Exception):
    """The process is gone."""


def configuration_of(name: str) -> Configuration:
    own = robot(name, HORIZON)
    return replace(
        own,
        weights=replace(own.weights, max_history=HORIZON // 2),
        revision=replace(own.revision, carried_probability=0.0),
    )


@pytest.fixture(scope="module", params=["given", "open"])
def configuration(request: pytest.FixtureRequest) -> Configuration:
    return configuration_of(request.param)


@pytest.fixture(scope="module")
def events(configuration: Configuration) -> list[Event]:
    tour = Tour(configuration).keyframes()
    return list(events_of([next(tour).keyframe for _ in range(NUM_KEYFRAMES)]))


@pytest.fixture(scope="module")
def undisturbed(
    configuration: Configuration, events: list[Event], tmp_path_factory: pytest.TempPathFactory
) -> dict[int, HybridBelief]:
    manager = Manager(tmp_path_factory.mktemp("undisturbed"), replace(configuration))
    for event in events:
        manager.receive(event)
    manager.close()
    return manager.beliefs


def test_it(configuration, events, undisturbed, tmp_path):
    assert len(undisturbed) > 60
    pool = KeepingPool()
    manager = Manager(tmp_path, configuration, pool)
    for n, event in enumerate(events):
        manager.receive(event)
        if n % 17 == 16:
            manager.close()
            pool = LivingPool(pool) if n % 2 else KeepingPool()
            manager = Manager(tmp_path, configuration, pool)
            print(n, manager.num_replayed, sorted(p.name for p in tmp_path.iterdir()))
        for k, b in manager.beliefs.items(): assert_same(b, undisturbed[k])
