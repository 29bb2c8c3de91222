"""A robot on a map that is carried after its manager was started again is found as if that had gone on."""

from dataclasses import dataclass

import numpy as np
import pytest
from worlds.living_pool import LivingPool
from worlds.same_beliefs import SUBSTANCE
from worlds.scenes.lost_world import STEP_SIGMAS, carried_world, configuration, errors, map_of

from semantic_slam import Configuration, Engine
from semantic_slam.errors import InputError
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.building import make_run_configuration, start_of_run
from semantic_slam.inference.checkpoints.records import packed, unpacked
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.kept_steps import KeptSteps
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.relocation.recovery import _Suspect
from semantic_slam.inference.revision.replay import CHECKPOINT, REACH
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.smoothing.past.horizon import apart
from semantic_slam.inference.states.keys import object_key, robot_key
from semantic_slam.inference.world.carried import SOON
from semantic_slam.inference.world.map_prior import MapPrior

START, THERE = np.array([4.0, -7.0, 1.9]), np.array([-1.0, -3.0, 0.4])
HORIZON, EARLY, BEFORE, AFTER = 44, 99, 104, 8
"""Marginalisations are no checkpoints; the oldest keyframes are out of a replay's reach when the state is stored."""
SUSPECTED = BEFORE + 2
"""Keyframes after which two in a row were unexpected."""
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
    stored_at: int  # keyframes
    stored: Engine  # another one, that stopped when its state was stored
    state: bytes

    def again(self) -> Engine:
        """An engine made again with that state and the backends of then."""
        assert isinstance(self.stored.pool, InProcessPool)
        made = Engine.of_run(self.run, LivingPool(self.stored.pool))
        made.restore(unpacked(self.state))
        return made


CLOSED = Configuration.of(association="enumerated", semantic_model={"kind": "none"}, **SETTINGS)
OPEN = configuration(**SETTINGS)


def driven(settings: Configuration, prior: MapPrior, keyframes: list[Keyframe], stored_at: int) -> Run:
    told = make_run_configuration(settings, prior, *start_of_run(settings, None, None), stamp_ns=1)
    engine, stored = (Engine.of_run(told, InProcessPool(1)) for _ in range(2))
    beliefs, storable = [], []
    for keyframe in keyframes:
        beliefs.append(engine.process(keyframe))
        storable.append(engine.may_be_stored)
        if keyframe.index < stored_at:
            stored.process(keyframe)
    return Run(told, beliefs, engine, storable, stored_at, stored, packed(stored.state()))


def assert_goes_on(run: Run, keyframes: list[Keyframe]) -> Engine:
    """An engine made again with what was stored believes the same to the bit."""
    again = run.again()
    assert again.may_be_stored and packed(again.state()) == run.state
    for keyframe, expected in zip(keyframes[run.stored_at :], run.beliefs[run.stored_at :], strict=True):
        belief = again.process(keyframe)
        for name in SUBSTANCE:
            np.testing.assert_array_equal(getattr(belief, name), getattr(expected, name), err_msg=name)
        assert again.may_be_stored == run.storable[keyframe.index]
    assert again.recovery._log_surplus == run.engine.recovery._log_surplus
    if again.may_be_stored:
        assert packed(again.state()) == packed(run.engine.state())
    return again


@pytest.fixture(
    scope="module",
    params=[(CLOSED, EARLY), (CLOSED, SUSPECTED), (OPEN, EARLY)],
    ids=["fixed map", "fixed map, suspected", "objects come and go"],
)
def run(request: pytest.FixtureRequest) -> Run:
    settings, stored_at = request.param
    return driven(settings, map_of(), WORLD.keyframes, stored_at)


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
    assert apart(run.engine.problem.history) % CHECKPOINT and run.stored_at > REACH * HORIZON
    again, belief = assert_goes_on(run, WORLD.keyframes), run.beliefs[-1]
    best, near = next(iter(again.live.values())), errors(belief, WORLD.truth[-1]) < 0.3
    assert [k for k, step in enumerate(best.lineage) if k and step.lattice_point] == [BEFORE]
    assert np.exp(belief.log_weights[near]).sum() > 0.9


def test_the_run_cannot_be_stored_while_it_is_searched_for_where_the_robot_was_set_down(run: Run) -> None:
    assert all(run.storable[:BEFORE])
    follows = run.engine.problem.association.tracks_objects  # new ground, from the first unexpected keyframe on
    assert not any(run.storable[BEFORE + (0 if follows else 3) : BEFORE + 4])


@pytest.mark.parametrize("horizon", [SOON, SOON + 1, 100])
def test_a_restarted_run_holds_every_keyframe_that_it_may_look_at_again(horizon: int) -> None:
    """On a fixed map the oldest suspect that is open yet, by ``LOOKS``, is within what replays reach, by ``REACH``.

    The shortest horizon is ``SOON``. Where objects come and go a run with suspects is not stored.
    """
    settings = Configuration.of(
        **(SETTINGS | {"history": {"horizon_keyframes": horizon}}),
        association="enumerated",
        semantic_model={"kind": "none"},
    )
    engine = Engine(settings, map_of())
    keyframe, recovery = Keyframe.planar(0, motion_sigmas=STEP_SIGMAS), engine.recovery
    engine.process(keyframe)
    for now in range(2, 2 * REACH * horizon):
        engine.steps.append(engine.steps[-1])
        oldest = next(since for since in range(now) if recovery._is_open(since, _Suspect(1.0), now))
        first = recovery.first_step
        assert first is not None and first <= oldest
    again = KeptSteps()
    again.go_on(engine.steps.stamps_ns, engine.steps[first:])
    assert len(again[oldest:]) == len(engine.steps) - oldest
    with pytest.raises(LostComponentError, match="forgotten at a restart"):
        again[first - 1 :]


@pytest.mark.parametrize("horizon", [20, SOON - 1])
def test_a_horizon_below_that_is_refused_where_the_robot_may_be_carried(horizon: int) -> None:
    settings = SETTINGS | {"history": {"horizon_keyframes": horizon}}
    with pytest.raises(InputError, match=f"set it to {SOON} or more"):
        Engine(Configuration.of(association="enumerated", semantic_model={"kind": "none"}, **settings), map_of())


@pytest.mark.long
def test_candidate_poses_that_wait_for_evidence_are_stored_right_after_a_marginalisation() -> None:
    """Of a single object, about which the robot may stand anywhere."""
    one, before, stored_at = np.array([[3.0, -2.0]]), 61, 7 * apart(CLOSED.history)
    keyframes = carried_world(START, THERE, before, 27, places=one).keyframes
    run = driven(CLOSED, map_of(one), keyframes, stored_at)
    waiting = run.stored.recovery._places.through
    assert waiting and [own.at for own in waiting] == [stored_at] * len(waiting)
    assert not any(run.storable[stored_at : stored_at + 10])
    again = assert_goes_on(run, keyframes)
    expected = run.engine.recovery._places.through
    assert expected and len(keyframes) == 8 * apart(CLOSED.history)
    for own, other in zip(again.recovery._places.through, expected, strict=True):
        assert (own.number, own.log_joint) == (other.number, other.log_joint)
