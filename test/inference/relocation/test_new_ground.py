"""A robot that is set down where nothing is mapped knows that it was carried, and not where it is."""

from dataclasses import replace

import numpy as np
import pytest
from worlds.scenes.lost_world import PLACES, STEP, LostWorld, configuration, make_world, map_of

from semantic_slam import Engine
from semantic_slam.errors import InputError
from semantic_slam.geometry.pose import planar_from_pose_vector
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.kept_steps import KeptSteps
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.revision.replay import Replay
from semantic_slam.inference.states.lineage import Lineage, LineageStep
from semantic_slam.inference.world.carried import NEW_GROUND, new_grounds
from semantic_slam.maps.from_belief import mapped_rows, num_unplaced
from semantic_slam.maps.from_run import saved_map_of_engine

START, THERE = np.array([4.0, -7.0, 1.9]), np.array([40.0, 3.0, 0.4])
BEFORE, AFTER = 3, 4
PROBABILITY, WIDTH_M = 1e-3, 5.0
CARRIED = {
    "revision": {"carried_probability": PROBABILITY, "carried_m": WIDTH_M},
    "initial_pose": {"mean": START.tolist(), "sigma": [0.01, 0.01, 0.01]},
}
ELSEWHERE = THERE[:2] + np.array([[2.5, -1.0], [4.0, 1.5], [5.5, -0.5]])


def on_new_ground() -> LostWorld:
    """A drive on the map, and another one from beyond it that goes on with it."""
    worlds = make_world(START, BEFORE), make_world(THERE, AFTER, places=ELSEWHERE, seed=1)
    first, second = (own.keyframes for own in worlds)
    apart_ns = first[1].stamp_ns - first[0].stamp_ns
    moved = [replace(own, index=own.index + BEFORE, stamp_ns=own.stamp_ns + BEFORE * apart_ns) for own in second]
    return LostWorld([*first, *moved], np.concatenate([own.truth for own in worlds]), [])


@pytest.fixture(scope="module")
def driven() -> tuple[Engine, list[HybridBelief]]:
    engine = Engine(configuration(**CARRIED), map_of())
    return engine, [engine.process(keyframe) for keyframe in on_new_ground().keyframes]


@pytest.mark.long
def test_a_robot_set_down_on_new_ground_knows_that_it_was_kidnapped(driven: tuple[Engine, list[HybridBelief]]) -> None:
    engine, _ = driven
    assert engine.carried > 0.99
    best = next(iter(engine.live.values()))
    assert new_grounds(best.lineage) == (BEFORE,)


def test_beyond_the_horizon_a_robot_without_a_map_is_taken_to_drive_on() -> None:
    engine = Engine(
        configuration(revision={**CARRIED["revision"], "horizon": BEFORE}, initial_pose=CARRIED["initial_pose"])
    )
    for keyframe in on_new_ground().keyframes:
        engine.process(keyframe)
    assert engine.carried == 0.0


def test_where_it_is_stays_as_wide_as_it_may_have_been_carried(driven: tuple[Engine, list[HybridBelief]]) -> None:
    _, beliefs = driven
    before, after = beliefs[BEFORE - 1], beliefs[-1]
    assert np.sqrt(np.diagonal(before.pose_covariances[0])[:2]).max() < 0.1
    assert (np.sqrt(np.diagonal(after.pose_covariances[0])[:2]) > 0.95 * WIDTH_M).all()
    away = planar_from_pose_vector(after.poses[0])[:2] - planar_from_pose_vector(before.poses[0])[:2]
    assert np.hypot(*away) < AFTER * STEP[0]  # the mean of all places where it may be


def test_the_map_stays_as_it_was_and_what_is_new_lies_anywhere(driven: tuple[Engine, list[HybridBelief]]) -> None:
    engine, beliefs = driven
    last = beliefs[-1]
    new = last.object_ids >= engine.registry.first_new_id(BEFORE)
    np.testing.assert_allclose(last.object_poses[~new][: len(PLACES), :2], PLACES, atol=0.05)
    spread = np.sqrt(last.object_covariances[:, 0, 0])
    assert (spread[~new][: len(PLACES)] < 0.05).all()
    assert (spread[new] > 0.95 * WIDTH_M).all() and new.sum() == len(ELSEWHERE)


def test_what_lies_anywhere_is_on_no_map(driven: tuple[Engine, list[HybridBelief]]) -> None:
    engine, beliefs = driven
    assert isinstance(engine.pool, InProcessPool)
    with pytest.raises(InputError, match="where on its map"):
        saved_map_of_engine(engine, engine.pool, beliefs[-1])


def test_neither_is_it_in_objects_json(driven: tuple[Engine, list[HybridBelief]]) -> None:
    """A later run would have them all at one point; kept is what lies on the map, by whichever hypothesis."""
    engine, beliefs = driven
    for belief in beliefs:
        spread = np.sqrt(belief.object_covariances[:, 0, 0])
        np.testing.assert_array_equal(mapped_rows(belief, engine.run), np.flatnonzero(spread < 0.2))
        assert num_unplaced(belief, engine.run) == (spread > 0.95 * WIDTH_M).sum()
    assert num_unplaced(beliefs[-1], engine.run) == len(ELSEWHERE)
    wide = replace(beliefs[0], object_covariances=beliefs[0].object_covariances + 100.0 * np.eye(6))
    assert num_unplaced(wide, engine.run) == 0, "where the robot knows its heading, what it hardly knows is placed"


def test_such_a_history_weighs_what_a_first_keyframe_does() -> None:
    """Nothing that was known before matters: p / (1 - p) times the evidence of a robot that begins there."""
    world = on_new_ground()
    engine = Engine(configuration(**CARRIED), map_of())
    replay = _replay(engine, world.keyframes[: BEFORE + 1])
    first, lineage = engine.registry.first_new_id(BEFORE), _named(world)
    seen = tuple(range(first, first + len(ELSEWHERE)))
    step = LineageStep(seen, (-1,) * len(seen)).with_lattice_point(NEW_GROUND)
    before, after = replay.before(lineage, BEFORE), replay.followed((*lineage, step))
    fresh = Engine(configuration(initial_pose={"mean": [0.0, 0.0, 0.0], "sigma": [0.01, 0.01, 0.01]}))
    alone = replace(world.keyframes[BEFORE], index=0)
    seen = tuple(range(fresh.registry.first_new_id(0), fresh.registry.first_new_id(0) + len(ELSEWHERE)))
    begun = _replay(fresh, [alone]).followed((LineageStep(seen, (-1,) * len(seen)),))
    assert before is not None and after is not None and begun is not None
    odds = float(np.log(PROBABILITY / (1.0 - PROBABILITY)))
    assert after.log_joint - before.log_joint == pytest.approx(odds + begun.log_joint, abs=0.02)


def test_where_its_frame_lies_widens_with_every_time_it_is_carried() -> None:
    carried = Engine(configuration(**CARRIED), map_of()).problem.carried
    assert carried is not None
    once, twice = carried.frame(START), carried.frame(START, 2)
    np.testing.assert_allclose(np.diagonal(once.covariance)[:2], WIDTH_M**2)
    np.testing.assert_allclose(twice.covariance, 2.0 * once.covariance)
    np.testing.assert_array_equal(once.mean, START)


def _replay(engine: Engine, keyframes: list) -> Replay:
    association = engine.association(engine.problem, engine.registry)
    steps = [engine.problem.reader.step(keyframe) for keyframe in keyframes]
    for step in steps:
        association.introduce(engine.registry, step)
    return Replay(engine.problem, association, KeptSteps(steps))


def _named(world: LostWorld) -> Lineage:
    """What the detections before it was carried are of."""
    names = make_world(START, BEFORE).names
    return tuple(LineageStep(own, (-1,) * len(own)) for own in names)
