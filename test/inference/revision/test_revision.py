"""Association revised afterwards: objects that are one become one, with the weight that they would have had."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from worlds.drives.drifted_return import LANDMARKS, SIGMAS, open_world, return_with_drift, seen_from
from worlds.drives.open_room import make_room
from worlds.same_beliefs import assert_same

from semantic_slam import Configuration, Engine, Keyframe
from semantic_slam.errors import InputError
from semantic_slam.evaluation.history import histories
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.backend import Backend
from semantic_slam.inference.kept_steps import KeptSteps
from semantic_slam.inference.open_world.keyframe.open_association import OpenAssociation
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import Commit, Components
from semantic_slam.inference.revision.catching_up import BRANCHES, BROKEN_PROMISE, HOPELESS, CatchingUp, Level
from semantic_slam.inference.revision.pairs import merged, relative_distances, seen_together
from semantic_slam.inference.revision.replay import CHECKPOINT, Replay
from semantic_slam.inference.smoothing import trunks
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.lineage import Lineage, LineageStep
from semantic_slam.ros.rounds.round_checks import fault_of_commit


@pytest.mark.long
def test_objects_that_were_started_twice_become_one_when_more_of_them_is_seen() -> None:
    engine, (*_, belief) = return_with_drift({"every_keyframes": 1})
    assert belief.object_ids.tolist() == [0, 1, 2]
    assert np.hypot(*belief.poses[0, :2]) < 0.1
    _, (*_, without) = return_with_drift({"every_keyframes": 0})
    assert len(without.object_ids) > len(LANDMARKS)
    assert engine.hypotheses.discarded.total < 1.0


@pytest.mark.long
def test_histories_that_enter_are_counted_among_those_that_a_long_run_follows() -> None:
    _, beliefs = return_with_drift({"every_keyframes": 1}, pruning={"max_hypotheses": 10, "max_poses": 1})
    assert sum(len(belief.revised_ids) for belief in beliefs) > 0
    assert [len(belief.hypothesis_ids) for belief in beliefs] == [1] * len(beliefs)


def test_what_two_objects_share_of_a_drift_brings_them_no_nearer() -> None:
    """Where the robot began is not known to metres: each post may be where the other one is, but not beside it."""
    engine = Engine(open_world({}), initial_covariance=np.diag([4.0, 4.0, 0.25]))
    engine.process(Keyframe.planar(0, detections=seen_from(np.zeros(3), [0, 1])))
    (held,) = engine.pool._backends[0].held.values()
    component = held.component
    far = relative_distances(component, [(0, 1), (1, 0)])
    covariances = component.tracked.covariances[:, :2, :2]
    offset = component.tracked.states[1, :2] - component.tracked.states[0, :2]
    assert np.sqrt(offset @ np.linalg.solve(covariances.sum(axis=0), offset)) < 2.0
    range_m, both = np.hypot(*LANDMARKS[0]), np.hypot(*(LANDMARKS[1] - LANDMARKS[0]))
    assert far[0] == pytest.approx(far[1], rel=1e-6)
    assert far[0] > 0.5 * both / (np.sqrt(2.0) * max(SIGMAS[0], SIGMAS[1] * range_m)) > 8.0


@pytest.mark.long
def test_beliefs_tell_every_history_as_it_was_revised() -> None:
    engine, beliefs = return_with_drift({"every_keyframes": 1})
    assert sum(len(belief.revised_ids) for belief in beliefs) > 0
    assert all(set(own.parent_ids) <= set(before.hypothesis_ids) for before, own in pairwise(beliefs))
    told = histories(beliefs)
    for row, live in enumerate(engine.live.values()):
        assert [tuple(found[row].tolist()) for found in told] == [step.association for step in live.lineage]


@pytest.mark.long
def test_histories_are_rebuilt_alike_from_the_prior_and_from_what_was_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    _, as_replayed = return_with_drift({"every_keyframes": 1})
    monkeypatch.setattr(InProcessPool, "offer", lambda pool, components: None)  # as backends elsewhere do
    monkeypatch.setattr(trunks, "APART", 2)
    began: list[int] = []

    def asked(kept: trunks.Trunks, numbers: Sequence[int]) -> tuple[int, Component] | None:
        found = deepest(kept, numbers)
        began.append(0 if found is None else found[0])
        return found

    deepest = trunks.Trunks.deepest
    monkeypatch.setattr(trunks.Trunks, "deepest", asked)
    _, with_trunks = return_with_drift({"every_keyframes": 1})
    assert max(began) > 0
    monkeypatch.setattr(trunks.Trunks, "deepest", lambda kept, numbers: None)
    _, from_prior = return_with_drift({"every_keyframes": 1})
    for one, other, third in zip(with_trunks, from_prior, as_replayed, strict=True):
        assert_same(one, other)
        assert_same(one, third)


class CheckedPool(InProcessPool):
    """Backends that are told what nodes would be told over topics, and refuse what those refuse."""

    def commit(self, commit: Commit) -> list[Components]:
        assert fault_of_commit(commit, self._backends[0].steps[commit.keyframe].stamp_ns) == ""
        return super().commit(commit)


def test_what_is_told_of_revised_histories_is_no_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("semantic_slam.inference.engine.InProcessPool", CheckedPool)
    _, beliefs = return_with_drift({"every_keyframes": 1})
    assert sum(len(belief.revised_ids) for belief in beliefs) > 0


@pytest.mark.long
def test_the_evidence_is_that_of_the_history_that_is_left() -> None:
    """Of each keyframe, too: what was found again counts where it was found, and not once more in the next one."""
    engine, beliefs = return_with_drift({"every_keyframes": 1})
    ((number, own),) = engine.live.items()
    replay = Replay(engine.problem, engine.association(engine.problem, engine.registry), engine.steps)
    found = replay.followed(own.lineage)
    assert found is not None
    assert found.number == number
    assert engine.log_evidence == pytest.approx(found.log_joint, abs=1e-6)
    later = beliefs[max(k for k, belief in enumerate(beliefs) if len(belief.revised_ids)) + 1 :]
    replayed = replay.before(own.lineage, len(beliefs) - len(later))
    assert later
    assert replayed is not None
    assert sum(belief.log_evidence for belief in later) == pytest.approx(found.log_joint - replayed.log_joint, abs=1e-6)


def test_what_was_replayed_is_not_rebuilt(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(backend: Backend, lineage: Sequence[LineageStep], length: int) -> Component:
        raise AssertionError("rebuilt what the manager has replayed")

    monkeypatch.setattr(Backend, "_rebuild", refused)
    _, beliefs = return_with_drift({"every_keyframes": 1})
    assert sum(len(belief.revised_ids) for belief in beliefs) > 0


def followed_in_a_room(num_keyframes: int) -> tuple[Engine, Replay]:
    """Several hypotheses, and what replays their histories."""
    room = make_room(num_keyframes, 4, clutter=0.6, open_world={"merge_position_m": 0.0, "iterate_updates": False})
    engine = Engine.of_run(room.run, InProcessPool(1))
    steps = []
    for keyframe in room.keyframes:
        engine.process(keyframe)
        steps.append(engine.problem.reader.step(keyframe))
    return engine, Replay(engine.problem, engine.association(engine.problem, engine.registry), KeptSteps(steps))


@pytest.mark.long
def test_a_replayed_history_weighs_what_it_weighed_when_it_was_followed() -> None:
    engine, replay = followed_in_a_room(12)
    live = list(engine.live.items())[:3]
    assert len(live) == 3
    found = [replay.followed(own.lineage) for _, own in live]
    expected = [own.log_weight + engine.log_evidence for _, own in live]
    assert [own.number for own in found if own is not None] == [number for number, _ in live]
    np.testing.assert_allclose([own.log_joint for own in found if own is not None], expected, atol=1e-9)
    assert replay.followed(live[-1][1].lineage) == found[-1]  # from where it was followed before


def test_a_history_is_replayed_as_it_says_where_other_objects_fit_better() -> None:
    """With two objects nearest to the detections a third that it names would begin anew, and be two from then on."""
    engine = Engine(open_world({}), initial_covariance=np.diag([1e-6] * 3))
    seen = [seen_from(np.zeros(3), numbers) for numbers in ([0, 1, 2], [0])]
    keyframes = [Keyframe.planar(k, detections=own, motion_sigmas=(1e-3,) * 3) for k, own in enumerate(seen)]
    for keyframe in keyframes:
        engine.process(keyframe)
    steps = [engine.problem.reader.step(keyframe) for keyframe in keyframes]
    right = next(iter(engine.live.values())).lineage
    assert [step.association for step in right] == [(0, 1, 2), (0,)]
    wrong = (right[0], replace(right[1], association=(2,)))
    found = []
    for limit in (2, 30):
        problem = replace(engine.problem, open_world=replace(engine.problem.open_world, max_joint_objects=limit))
        replay = Replay(problem, OpenAssociation(problem, engine.registry), KeptSteps(steps), engine.registry)
        found.append(replay.followed(wrong))
    cut, whole = found
    assert cut is not None and whole is not None and cut.lineage == whole.lineage == wrong
    np.testing.assert_allclose(cut.log_joints, whole.log_joints, rtol=1e-9)


@pytest.mark.long
def test_a_history_that_caught_up_is_followed_from_there_on(monkeypatch: pytest.MonkeyPatch) -> None:
    engine, replay = followed_in_a_room(CHECKPOINT)
    first, other = [own.lineage for own in engine.live.values()][:2]
    waiting = CatchingUp(replay)
    replay.followed(first)
    waiting.add([other])
    (level,) = waiting.go_on(CHECKPOINT)
    monkeypatch.setattr(Replay, "advanced", None)
    assert replay.followed(other) == level.own


@pytest.mark.long
def test_a_replay_is_given_up_where_it_is_far_behind_the_history_that_it_revises() -> None:
    engine, replay = followed_in_a_room(12)
    first, other = [own.lineage for own in engine.live.values()][:2]
    (level,) = _caught_up(replay, [other], ())
    assert level.own is not None
    own = np.array(level.own.log_joints)
    assert len(own) == 13
    early, late = (np.where(np.arange(12) == keyframe, 1.0, 0.0) for keyframe in (4, 5))
    for nats, gains, reaches_the_end in (
        (HOPELESS - 1e-6, None, True),
        (HOPELESS + 1e-6, None, False),
        (BROKEN_PROMISE - 1e-6, early, True),
        (BROKEN_PROMISE + 1e-6, early, False),  # what was promised of keyframe 4 is not to come any more after 5
        (BROKEN_PROMISE + 1.0 - 1e-6, late, True),
        (BROKEN_PROMISE + 1.0 + 1e-6, late, False),
    ):
        better = own + np.where(np.arange(13) == 5, nats, 0.0)
        alone, beside = _caught_up(replay, [other, first], better.tolist(), gains)
        assert (alone.own is not None) == reaches_the_end and beside.own is not None


def _caught_up(
    replay: Replay, lineages: Sequence[Lineage], against: Sequence[float], gains: Array | None = None
) -> list[Level]:
    waiting = CatchingUp(replace(replay, _kept={}, _beside={}))
    waiting.add(lineages, against, gains)
    return list(waiting.go_on(100))


def test_histories_that_wait_catch_up_a_few_keyframes_at_a_time() -> None:
    """With what they weigh, one after the other; what is impossible among them holds nobody up."""
    engine, replay = followed_in_a_room(12)
    first, other = [own.lineage for own in engine.live.values()][:2]
    impossible = (replace(first[0], association=(10**6,) * len(first[0].association)), *first[1:])
    waiting = CatchingUp(replay)
    waiting.add([first, impossible, other])
    looks = [list(waiting.go_on(5)) for _ in range(5)]
    assert [[level.asked for level in found] for found in looks] == [[], [], [first, impossible], [], [other]]
    assert waiting.is_idle
    levels = [level.own for found in looks for level in found]
    assert levels[1] is None
    assert [levels[0], levels[2]] == [replay.followed(first), replay.followed(other)]


def test_a_history_that_waits_goes_on_as_is_likeliest_for_it() -> None:
    """By the end, which need not be likeliest on the way."""
    engine, replay = followed_in_a_room(12)
    best = next(iter(engine.live.values())).lineage
    waiting = CatchingUp(replay)
    waiting.add([best[:4]])
    ((_, own),) = waiting.go_on(12 * BRANCHES)
    greedy = replay.followed(best[:4])
    assert own is not None and greedy is not None
    assert own.lineage[:4] == best[:4]
    assert len(own.lineage) == 12
    assert own.log_joint >= greedy.log_joint
    named = replay.followed(own.lineage)
    assert named is not None
    assert (named.number, named.parent_id, named.lineage) == (own.number, own.parent_id, own.lineage)
    np.testing.assert_allclose(
        [named.log_joint, named.expected_births], [own.log_joint, own.expected_births], atol=1e-9
    )


@pytest.mark.slow
def test_a_revised_belief_is_that_of_any_number_of_backends() -> None:
    room = make_room(16, 4, clutter=0.3, open_world={"iterate_updates": False}, revision={"every_keyframes": 2})
    one, two = (Engine.of_run(room.run, InProcessPool(number)) for number in (1, 2))
    for keyframe in room.keyframes:
        assert_same(two.process(keyframe), one.process(keyframe))


def test_objects_of_one_frame_are_two() -> None:
    lineage = (LineageStep((4, 7), (-1, -1)), LineageStep((9,), (-1,)))
    assert seen_together(lineage) == {(4, 7)}
    assert [step.association for step in merged(lineage, [(4, 9)])] == [(4, 7), (4,)]


def test_a_world_with_a_map_is_not_revised() -> None:
    with pytest.raises(InputError, match="association: open"):
        Engine(Configuration.of(association="given", revision={"every_keyframes": 5}))
