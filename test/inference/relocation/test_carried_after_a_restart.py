"""A robot on a map that is carried after its manager was started again is found as if that had gone on."""

from dataclasses import dataclass

import numpy as np
import pytest
from worlds.living_pool import LivingPool
from worlds.same_beliefs import SUBSTANCE
from worlds.scenes.lost_world import carried_world, configuration, errors, map_of

from semantic_slam import Configuration, Engine
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.building import make_run_configuration, start_of_run
from semantic_slam.inference.checkpoints.records import packed, unpacked
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.revision.replay import CHECKPOINT, REACH
from semantic_slam.inference.smoothing.past.horizon import apart
from semantic_slam.inference.states.keys import object_key, robot_key

START, THERE = np.array([4.0, -7.0, 1.9]), np.array([-1.0, -3.0, 0.4])
HORIZON, STORED_AT, BEFORE, AFTER = 44, 99, 104, 8
"""Marginalisations are no checkpoints; the oldest keyframes are out of a replay's reach when the state is stored."""
SETTINGS = {
    "history": {"horizon_keyframes": HORIZON},
    "initial_pose": {"mean": START.tolist(), "sigma": [0.01, 0.01, 0.01]},
    "pruning": {"max_hypotheses": 3},
    "revision": {"carried_probability": 1e-3, "carried_m": 5.0},
}
WORLD = carried_world(START, THERE, BEFORE, AFTER)


@dataclass(frozen=True)
class Run:
    """A run that is not disturbed, and what was stored of it on the way."""

    run: RunConfiguration
    beliefs: list[HybridBelief]
    engine: Engine
    storable: list[bool]  # after each keyframe
    stored: Engine  # another one, that stopped when its state was stored
    state: bytes

    def again(self) -> Engine:
        """An engine made again with that state and the backends of then."""
        assert isinstance(self.stored.pool, InProcessPool)
        made = Engine.of_run(self.run, LivingPool(self.stored.pool))
        made.restore(unpacked(self.state))
        return made


@pytest.fixture(scope="module", params=["fixed map", "objects come and go"])
def run(request: pytest.FixtureRequest) -> Run:
    closed = Configuration.of(association="enumerated", semantic_model={"kind": "none"}, **SETTINGS)
    settings = closed if request.param == "fixed map" else configuration(**SETTINGS)
    told = make_run_configuration(settings, map_of(), *start_of_run(settings, None, None), stamp_ns=1)
    engine, stored = (Engine.of_run(told, InProcessPool(1)) for _ in range(2))
    beliefs, storable = [], []
    for keyframe in WORLD.keyframes:
        beliefs.append(engine.process(keyframe))
        storable.append(engine.may_be_stored)
        if keyframe.index < STORED_AT:
            stored.process(keyframe)
    return Run(told, beliefs, engine, storable, stored, packed(stored.state()))


def test_every_checkpoint_of_a_replay_is_made_again_to_the_bit(run: Run) -> None:
    replay, made = run.stored.recovery._replay, run.again()
    found = [own for own in replay._kept.values() if own.at >= replay.reach]
    assert len(found) > 4 and any(own.at % apart(run.stored.problem.history) for own in found)
    for own in sorted(found, key=lambda own: own.at):
        again = made.recovery._replay.resumed(own.lineage[: own.at])
        assert (again.at, again.number, again.log_joints) == (own.at, own.number, own.log_joints)
        assert again.expected_births == own.expected_births
        keys = [robot_key(own.at - 1), *(object_key(n) for n in sorted(own.component.object_ids))]
        one, other = again.component, own.component
        np.testing.assert_array_equal(one.states(keys), other.states(keys))
        np.testing.assert_array_equal(one.joint_covariance(keys), other.joint_covariance(keys))


@pytest.mark.long
def test_a_robot_that_is_carried_after_a_restart_is_found_to_the_bit(run: Run) -> None:
    assert apart(run.engine.problem.history) % CHECKPOINT and REACH * HORIZON < STORED_AT
    again = run.again()
    assert again.may_be_stored and packed(again.state()) == run.state
    for keyframe, expected in zip(WORLD.keyframes[STORED_AT:], run.beliefs[STORED_AT:], strict=True):
        belief = again.process(keyframe)
        for name in SUBSTANCE:
            np.testing.assert_array_equal(getattr(belief, name), getattr(expected, name), err_msg=name)
    assert again.recovery._log_surplus == run.engine.recovery._log_surplus
    best, near = next(iter(again.live.values())), errors(belief, WORLD.truth[-1]) < 0.3
    assert [k for k, step in enumerate(best.lineage) if k and step.lattice_point] == [BEFORE]
    assert np.exp(belief.log_weights[near]).sum() > 0.9


def test_the_run_is_storable_but_while_it_looks_for_where_the_robot_was_carried(run: Run) -> None:
    first = run.storable.index(False)
    assert first == BEFORE and not any(run.storable[BEFORE : BEFORE + 4])
