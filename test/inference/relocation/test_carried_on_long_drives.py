"""A robot that is carried away on a drive of which old poses are marginalised is found as if they were not."""

import pickle
from typing import Any

import numpy as np
import pytest
from worlds.same_beliefs import assert_same
from worlds.scenes.lost_world import PLACES, LostWorld, carried_world, configuration, errors, map_of

from semantic_slam import Configuration, Engine
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.relocation.places import MOST
from semantic_slam.inference.relocation.recovery import LOOKS
from semantic_slam.inference.revision.replay import REACH
from semantic_slam.inference.world.carried import SOON, new_grounds

START, THERE, BEYOND = np.array([4.0, -7.0, 1.9]), np.array([-1.0, -3.0, 0.4]), np.array([40.0, 3.0, 0.4])
BEFORE, AFTER = 90, 6
EARLY, LONG_AFTER = 10, 50
PROBABILITY, WIDTH_M = 1e-3, 5.0
MAY_BE: dict[str, Any] = {
    "revision": {"carried_probability": PROBABILITY, "carried_m": WIDTH_M},
    "initial_pose": {"mean": START.tolist(), "sigma": [0.01, 0.01, 0.01]},
    "pruning": {"max_hypotheses": 3},
}
LONG = {"history": {"horizon_keyframes": SOON}}
NEW = BEYOND[:2] + np.array([[2.5, -1.0], [4.0, 1.5], [5.5, -0.5], [1.0, 5.5]])


def driven(world: LostWorld, *, backends: int = 1, **others: Any) -> tuple[Engine, list[HybridBelief]]:
    engine = Engine(configuration(**MAY_BE, **others), map_of(), backends=backends)
    return engine, [engine.process(keyframe) for keyframe in world.keyframes]


def oldest_pose(engine: Engine) -> int:
    assert isinstance(engine.pool, InProcessPool)
    return engine.pool.component(next(iter(engine.live))).oldest


@pytest.fixture(scope="module")
def found() -> tuple[Engine, list[HybridBelief]]:
    return driven(carried_world(START, THERE, BEFORE, AFTER), **LONG)


@pytest.mark.long
def test_a_robot_kidnapped_on_a_long_drive_is_localised_where_it_was_set_down(
    found: tuple[Engine, list[HybridBelief]],
) -> None:
    engine, beliefs = found
    assert oldest_pose(engine) > 0
    assert BEFORE + AFTER > REACH * SOON  # what is replayed does not begin at the start
    near = errors(beliefs[-1], carried_world(START, THERE, BEFORE, AFTER).truth[-1]) < 0.3
    assert np.exp(beliefs[-1].log_weights[near]).sum() > 0.9
    best = next(iter(engine.live.values()))
    assert [k for k, step in enumerate(best.lineage) if k and step.lattice_point] == [BEFORE]


@pytest.mark.long
def test_the_pose_after_a_kidnapping_is_that_of_a_smoother_with_all_poses(
    found: tuple[Engine, list[HybridBelief]],
) -> None:
    _, whole = driven(carried_world(START, THERE, BEFORE, AFTER))
    ours, other = found[1][-1], whole[-1]
    sigmas = np.sqrt(np.diagonal(other.pose_covariances[0]))
    assert (np.abs(ours.poses[0, :2] - other.poses[0, :2]) < 0.05 * sigmas[:2]).all()
    stated = np.sqrt(np.diagonal(ours.pose_covariances[0]))[[0, 1, 5]]
    np.testing.assert_allclose(stated, sigmas[[0, 1, 5]], rtol=0.03)
    np.testing.assert_allclose(np.exp(ours.log_weights[0]), np.exp(other.log_weights[0]), atol=0.02)


@pytest.mark.long
@pytest.mark.slow
def test_backends_that_rebuild_it_from_their_checkpoints_believe_the_same(
    found: tuple[Engine, list[HybridBelief]],
) -> None:
    _, divided = driven(carried_world(START, THERE, BEFORE, AFTER), backends=2, **LONG)
    for one, two in zip(found[1], divided, strict=True):
        assert_same(one, two)


@pytest.mark.long
def test_on_new_ground_it_knows_no_more_of_where_it_is_once_the_carry_is_long_ago() -> None:
    engine, beliefs = driven(carried_world(START, BEYOND, EARLY, LONG_AFTER, new=NEW), **LONG)
    assert oldest_pose(engine) > EARLY
    best = next(iter(engine.live.values()))
    assert best.grounds == new_grounds(best.lineage) == (EARLY,)
    assert engine.carried > 0.99
    last = beliefs[-1]
    assert (np.sqrt(np.diagonal(last.pose_covariances[0])[:2]) > 0.95 * WIDTH_M).all()
    new = last.object_ids >= engine.registry.first_new_id(EARLY)
    np.testing.assert_allclose(last.object_poses[~new][: len(PLACES), :2], PLACES, atol=0.05)
    spread = np.sqrt(last.object_covariances[:, 0, 0])
    assert (spread[~new][: len(PLACES)] < 0.05).all()
    exist = new & (last.existence > 0.5)
    assert (spread[exist] > 0.95 * WIDTH_M).all() and exist.sum() == len(NEW)


def test_keyframes_that_no_replay_may_begin_at_any_more_are_not_held_in_memory(
    found: tuple[Engine, list[HybridBelief]],
) -> None:
    engine, _ = found
    assert len(engine.steps) == BEFORE + AFTER
    assert engine.steps.num_on_disk == BEFORE + AFTER - REACH * SOON
    assert [step.index for step in engine.steps] == list(range(BEFORE + AFTER))


@pytest.mark.long
def test_a_candidate_pose_that_waits_for_good_grows_by_its_lineage_alone() -> None:
    """Of a single object, about which the robot may stand anywhere: no more poses than a horizon holds, few bytes."""
    one, drive, horizon = np.array([[3.0, -2.0]]), 200, 44
    settings = MAY_BE | {"history": {"horizon_keyframes": horizon}}
    plain = Configuration.of(association="enumerated", semantic_model={"kind": "none"}, **settings)
    engine, sizes = Engine(plain, map_of(one)), []
    for keyframe in carried_world(START, THERE, 61, drive - 61, places=one).keyframes:
        engine.process(keyframe)
        waiting = engine.recovery._places.through
        assert len(waiting) <= MOST and len(engine.recovery._suspects) <= LOOKS[-1]
        for own in waiting:
            assert own.at - own.component.oldest <= 2 * horizon
            sizes.append((own.at, len(pickle.dumps((own.lineage, own.log_joints)))))
    (first, small), (last, large) = sizes[0], sizes[-1]
    assert last == drive and last - first > 2 * horizon
    assert (large - small) / (last - first) < 40.0, "bytes for each keyframe"
