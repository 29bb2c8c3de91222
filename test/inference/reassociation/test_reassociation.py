"""Histories of long drives changed in closed form: they weigh what a replay says, and whoever repeats them agrees."""

from collections import Counter
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from worlds.drives.two_visits import LABELS, LANDMARKS, LENGTH, SPEED_M, VISIT, configured, keyframes
from worlds.same_beliefs import assert_same

from semantic_slam import Engine, HybridBelief
from semantic_slam.contracts.forgetful_pool import ForgetfulPool
from semantic_slam.evaluation.history import histories
from semantic_slam.inference.building import make_run_configuration, problem_of, start_of_run
from semantic_slam.inference.kept_steps import KeptSteps
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import BackendPool
from semantic_slam.inference.reassociation.joint_pairs import JointPairs
from semantic_slam.inference.reassociation.reassociation import Reassociation
from semantic_slam.inference.revision.replay import Replay
from semantic_slam.inference.smoothing.reassociation import Sighted, log_evidence
from semantic_slam.inference.states.lineage import LineageStep, as_followed, next_id, revised

EVERY = 10
LOOK = 100
"""Keyframe before which the look comes that finds both visits."""
BOUNDS = {"none": 2.5, "detector": 2.5, "embedding": 4.0, "detector_embedding": 4.0}
"""Nats by which the closed form may be off a replay: vectors of one gain of 120 nats weigh 1.4 less than there."""
KINDS = list(BOUNDS)


def driven(
    every: int, pool: BackendPool | None = None, until: int = LENGTH, kind: str = "none"
) -> tuple[Engine, list[HybridBelief]]:
    configuration = configured(every, kind)
    pose, covariance = start_of_run(configuration, None, np.diag([1e-6] * 3))
    run = make_run_configuration(configuration, None, pose, covariance, stamp_ns=0)
    engine = Engine.of_run(run, pool or InProcessPool(1))
    return engine, [engine.process(keyframe) for keyframe in keyframes()[:until]]


@cache
def looking(kind: str = "none") -> tuple[Engine, list[HybridBelief]]:
    return driven(EVERY, kind=kind)


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_a_corridor_that_was_mapped_twice_is_one_in_a_drive_that_is_never_replayed(kind: str) -> None:
    _, (*_, without) = driven(0, kind=kind)
    engine, beliefs = looking(kind)
    assert len(without.object_ids) > len(LANDMARKS) + 4
    assert len(beliefs[-1].object_ids) == len(LANDMARKS)
    assert beliefs[LOOK].log_evidence < 20.0 < engine.log_evidence - sum(own.log_evidence for own in beliefs)
    true_end = SPEED_M * VISIT, 0.0
    assert np.hypot(*(beliefs[-1].poses[0, :2] - true_end)) < 0.15
    assert np.hypot(*(without.poses[0, :2] - true_end)) > 0.5


@pytest.mark.long
def test_what_is_told_of_the_past_names_the_objects_that_are_left() -> None:
    engine, beliefs = looking()
    told = histories(beliefs)
    for row, live in enumerate(engine.live.values()):
        assert [tuple(found[row].tolist()) for found in told] == [step.association for step in live.lineage]
    named = {number for step in next(iter(engine.live.values())).lineage for number in step.association}
    assert named == set(beliefs[-1].object_ids.tolist())


def test_objects_that_are_one_after_all_are_called_what_they_were_called_on_both_visits() -> None:
    _, beliefs = looking("detector")
    belief = beliefs[-1]
    for place, label in zip(LANDMARKS, LABELS, strict=True):
        (own,) = (one for one in belief.objects if np.hypot(*(one.position[:2] - place)) < 0.5)
        assert own.class_probabilities[label] > 0.75


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_a_change_weighs_in_closed_form_what_a_replay_of_the_drive_says(kind: str) -> None:
    """Without what was seen once, as the robot came back: there a replay makes all linear far from where it was."""
    engine, _ = driven(LOOK, until=LOOK, kind=kind)
    settings = replace(engine.problem.revision, reassociate_every_keyframes=EVERY)
    association = engine.association(engine.problem, engine.registry)
    looks = Reassociation(replace(engine.problem, revision=settings), association)
    reader = problem_of(engine.run).reader  # from the first keyframe on, as vectors are compared with earlier ones
    steps = [reader.step(keyframe) for keyframe in keyframes()[: LOOK + 1]]
    (held,) = engine.pool._backends[0].held.values()
    found, times = looks._changes(steps[LOOK], held.component), Counter(Sighted.of(held.component.smoother).objects)
    changes = [own for own in found if times[own[3]] > 1]
    own, lineage = looks.revised(steps[LOOK], held.component, changes), next(iter(engine.live.values())).lineage
    replay = Replay(engine.problem, association, KeptSteps(steps[:LOOK]))
    before, after = map(replay.followed, (lineage, revised(lineage, changes)))
    assert own.log_gain == pytest.approx(after.log_joint - before.log_joint, abs=BOUNDS[kind])
    assert own.log_gain > 30.0
    np.testing.assert_allclose(own.component.tracked.states, after.component.tracked.states, atol=0.02)
    np.testing.assert_allclose(own.component.objects.existence, after.component.objects.existence, atol=0.05)
    np.testing.assert_allclose(own.component.objects.track_scores, after.component.objects.track_scores, rtol=0.35)


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_changes_and_their_inverse_lead_back_to_what_was(kind: str) -> None:
    engine, _ = driven(LOOK, until=LOOK, kind=kind)
    (held,) = engine.pool._backends[0].held.values()
    step = engine.problem.reader.step(keyframes()[LOOK])
    looks = Reassociation(engine.problem, engine.association(engine.problem, engine.registry))
    sighted = Sighted.of(held.component.smoother)
    rows = np.flatnonzero(sighted.objects == sighted.objects[-1])
    number = int(sighted.objects[0])
    columns = sighted.keyframes, sighted.numbers, np.full(len(sighted.objects), number), sighted.objects
    there = list(zip(*(column[rows].tolist() for column in columns), strict=True))
    back = [(keyframe, detection, before, now) for keyframe, detection, now, before in there]
    first = looks.revised(step, held.component, there)
    second = looks.revised(step, first.component, back)
    assert first.log_gain < -30.0
    assert second.log_gain == pytest.approx(-first.log_gain, abs=0.6)
    assert log_evidence(second.component.smoother) == pytest.approx(log_evidence(held.component.smoother), abs=0.6)
    told, again = held.component.views, second.component.views
    assert told.keys() == again.keys()
    assert bool(told) == (kind != "none")
    for object_id, record in told.items():
        # what is added again has the shares of classes of then, not of when it was first added
        np.testing.assert_allclose(again[object_id].log_likelihood, record.log_likelihood, atol=0.1)
        assert (record.appearance is not None) == ("embedding" in kind)
        if record.appearance is not None:
            looks = [views.appearance for views in (record, again[object_id])]
            (mean, spread), (own, wide) = (one.mean_direction(np.zeros(len(one.log_settings))) for one in looks)
            np.testing.assert_allclose(own, mean, atol=1e-3)
            assert wide == pytest.approx(spread, rel=0.01)


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_a_backend_that_rebuilds_a_revised_history_comes_to_the_same_belief(kind: str) -> None:
    _, whole = looking(kind)
    _, divided = driven(EVERY, ForgetfulPool(2, dies_at=LOOK + 2), kind=kind)
    for one, other in zip(whole, divided, strict=True):
        assert_same(one, other)


def test_a_lineage_tells_how_it_was_followed() -> None:
    steps = tuple(LineageStep((number, 7), (-1, -1)) for number in range(4))
    changes = ((1, 0, 5, 1), (2, 1, 5, 7))
    own = (*revised(steps, changes), LineageStep((5,), (-1,), changes=changes))
    assert [step.association for step in own] == [(0, 7), (5, 7), (2, 5), (3, 7), (5,)]
    assert as_followed(own)[:4] == steps
    assert next_id(1, 2, own[4]) != next_id(1, 2, replace(own[4], changes=()))


def test_pairs_that_are_ambiguous_alone_are_not_together() -> None:
    """Posts at uneven distances, mapped twice with one shift that nobody knows to metres: one shift fits them all."""
    posts = np.array([[x, 0.0] for x in (0.0, 1.0, 2.3, 3.1, 5.0)])
    shift = np.array([1.1, 0.2])
    places = np.concatenate([posts, posts + shift])
    second = np.repeat([0.0, 1.0], len(posts))
    together = np.outer(second, second) + 1e-4 * np.eye(len(places))
    covariance = np.kron(together, np.eye(2))
    count = len(posts)
    pairs = np.array([(older, count + younger) for older in range(count) for younger in range(count)])
    found, rows = JointPairs(places, covariance, pairs, log_new=-2.0).best()
    assert {tuple(pair) for pair in pairs[rows].tolist()} == {(n, count + n) for n in range(count)}
    one_by_one = -0.5 * shift @ shift / (1.0 + 2e-4) - np.log(2.0 * np.pi * (1.0 + 2e-4)) + 2.0
    assert found > one_by_one + 4 * (-np.log(2.0 * np.pi * 3e-4) + 2.0 - 0.1)


def test_a_return_is_found_by_the_few_objects_of_a_long_stretch_that_it_shows() -> None:
    """Eight posts of a hundred are mapped twice, with one shift; each other one is near an old one by chance."""
    random = np.random.default_rng(0)
    old, shift = random.uniform(0.0, 30.0, size=(100, 2)), np.array([1.1, 0.2])
    returned = 5 + 12 * np.arange(8)
    young = old + random.normal(0.0, 1.0, size=old.shape)
    young[returned] = old[returned] + shift
    count = len(old)
    second = np.repeat([0.0, 1.0], count)
    covariance = np.kron(np.outer(second, second) + 1e-4 * np.eye(2 * count), np.eye(2))
    pairs = np.array([(number, count + number) for number in range(count)])
    _, rows = JointPairs(np.concatenate([old, young]), covariance, pairs, log_new=-2.0).best()
    assert set(returned.tolist()) <= set(rows.tolist())
    assert len(rows) <= len(returned) + 2  # beyond them those that their own shift puts there
