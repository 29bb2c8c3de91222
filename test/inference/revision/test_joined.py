"""Duplicates in space: a history in which two objects are one is found, and weighs what it would when followed live."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from semantic_slam import Configuration, Detection, Engine, Keyframe
from semantic_slam.geometry import se3, so3
from semantic_slam.inference.kept_steps import KeptSteps
from semantic_slam.inference.revision.hindsight.joined import joined, likeliest_group
from semantic_slam.inference.revision.hindsight.proposals import Proposals
from semantic_slam.inference.revision.hindsight.spatial import SpatialHindsight
from semantic_slam.inference.revision.pairs import relative_distances, relative_positions
from semantic_slam.inference.revision.replay import Replay, Revised
from semantic_slam.inference.states.keys import object_key, robot_key
from semantic_slam.inference.states.lineage import Lineage

ORIGIN = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
POINTS = np.array([[2.0, 0.0, 0.3], [1.8, 1.4, -0.3]])
RAY_SIGMA, NUM_KEYFRAMES, TURN = 0.01, 40, 20
LONG_STEP_M = 0.2
"""Standard deviation of odometry at the turn, along each axis."""


def keyframes(drift_m: float, sigma_m: float = LONG_STEP_M) -> Iterator[Keyframe]:
    """Sideways past two points, to which there are rays alone, and back.

    In between odometry, known to ``sigma_m`` there, is wrong by ``drift_m``. After that the first point alone is in
    sight.
    """
    random, x = np.random.default_rng(2), ORIGIN
    for k in range(NUM_KEYFRAMES):
        told = np.array([0.0, 0.0, 0.0, 0.0, 0.05 if k < TURN else -0.05, 0.0])
        covariance, error = 1e-6 * np.eye(6), np.zeros(6)
        if k == TURN:
            covariance[:3, :3], error[4] = sigma_m**2 * np.eye(3), drift_m
        x, detections = se3.compose(x, se3.exp(told + error)), []
        for point in POINTS[: 1 if TURN <= k < TURN + 3 else None]:
            away = so3.rotated(so3.inverse(x[3:]), point - x[:3])
            ray = away / np.linalg.norm(away) + RAY_SIGMA * random.normal(size=3)
            detections.append(Detection.along(ray, ray_covariance=RAY_SIGMA**2 * np.eye(3)))
        yield Keyframe.spatial(k, motion=se3.exp(told), motion_covariance=covariance, detections=detections)


def walked(every_keyframes: int, birth_density: float, drift_m: float, sigma_m: float = LONG_STEP_M) -> Engine:
    """An engine after the walk, with one hypothesis."""
    engine = Engine(
        Configuration.of(
            state_space="spatial",
            observation="points",
            association="open",
            semantic_model={"kind": "none"},
            open_world={
                "birth_density": birth_density,
                "clutter_per_frame": 0.01,
                "detection_probability": 0.9,
                "occluder_radius_m": 0.05,
            },
            pruning={"max_hypotheses": 1},
            revision={"every_keyframes": every_keyframes},
        ),
        initial_pose=ORIGIN,
        initial_covariance=1e-6 * np.eye(6),
    )
    for keyframe in keyframes(drift_m, sigma_m):
        engine.process(keyframe)
    return engine


def best(engine: Engine) -> Lineage:
    return next(iter(engine.live.values())).lineage


def replay_of(engine: Engine) -> Replay:
    """One that begins at the prior."""
    association = engine.association(engine.problem, engine.registry)
    return Replay(engine.problem, association, KeptSteps([*engine.steps]), engine.registry)


@pytest.fixture(scope="module")
def right() -> Engine:
    """An engine whose only history has both points right."""
    engine = walked(10**6, 0.3, 0.0)
    assert {number for step in best(engine) for number in step.association} == {0, 1}
    return engine


@pytest.fixture(scope="module")
def twice(right: Engine) -> tuple[Replay, Revised, int]:
    """The history in which the second point is another one after the turn, and that one's id."""
    anew = right.registry.first_new_id(TURN + 3) + 1
    steps = [
        replace(step, association=tuple(anew if number == 1 else number for number in step.association))
        for step in best(right)[TURN:]
    ]
    replay = replay_of(right)
    own = replay.followed((*best(right)[:TURN], *steps))
    assert own is not None
    return replay, own, anew


def test_a_history_with_duplicates_joined_is_that_which_was_followed_live(
    right: Engine, twice: tuple[Replay, Revised, int]
) -> None:
    """In weight and means, to rounding."""
    replay, own, anew = twice
    (history,) = Proposals(4, replay, right.registry).histories(own, [(1, anew)])
    assert history == best(right)
    revised = replay_of(right).followed(history)
    ((number, live),) = right.live.items()
    assert revised is not None and revised.number == number
    assert revised.log_joint == pytest.approx(live.log_weight + right.log_evidence, abs=1e-9)
    held = right.pool._backends[0].held[number].component
    keys = [*map(robot_key, range(NUM_KEYFRAMES)), object_key(0), object_key(1)]
    np.testing.assert_allclose(revised.component.states(keys), held.states(keys), atol=1e-9)


def test_a_join_promises_about_what_it_gains(right: Engine, twice: tuple[Replay, Revised, int]) -> None:
    """To a few nats: priors of ranges, and objects that hide each other, are left out."""
    replay, own, anew = twice
    revised = replay_of(right).followed(best(right))
    assert revised is not None
    (found,) = joined(SpatialHindsight.of(replay, right.registry, own), [(1, anew)], 0.0)
    assert found.gains.sum() == pytest.approx(revised.log_joint - own.log_joint, abs=5.0)
    assert not found.gains[: TURN + 3].any()  # nothing has changed so far


def test_objects_that_are_two_are_not_joined(right: Engine, twice: tuple[Replay, Revised, int]) -> None:
    replay, own, anew = twice
    view = SpatialHindsight.of(replay, right.registry, own)
    assert joined(view, [(0, anew)], 5.0) == []
    assert joined(view, [(0, 10**6)], 5.0) == []  # an object that does not exist
    (found,) = joined(view, [(0, anew), (1, anew)], 0.0)
    assert found.pairs == ((1, anew),)  # the likeliest partner of what may be in two pairs


def test_pairs_that_a_drift_has_moved_alike_are_one_each_or_none() -> None:
    """Of joint density as a whole; of three pairs the third, which was not moved, is left out."""
    offsets = np.array([[0.5, 0.0], [0.5, 0.0], [-0.5, 0.0]])
    spreads = np.tile(0.06 * np.eye(2), (3, 3, 1, 1))
    spreads[range(3), range(3)] += 0.001 * np.eye(2)
    objects = np.array([[0, 3], [1, 4], [2, 5]])
    found = likeliest_group(objects, offsets, spreads, np.array([0.0, 0.0, 0.0]), 0)
    assert list(found) == [0, 1]
    whole = spreads[:2, :2].transpose(0, 2, 1, 3).reshape(4, 4)
    assert sum(found.values()) == pytest.approx(multivariate_normal(np.zeros(4), whole).logpdf(offsets[:2].ravel()))
    assert found[0] < 0.0 < sum(found.values())  # either alone would lose


def test_relative_places_are_those_of_the_joint_gaussian(twice: tuple[Replay, Revised, int]) -> None:
    _, own, anew = twice
    pairs = [(1, anew), (0, 1)]
    offsets, spreads = relative_positions(own.component, pairs)
    keys = [object_key(number) for number in (0, 1, anew)]
    states, joint = own.component.states(keys)[:, :3], own.component.joint_covariance(keys)
    np.testing.assert_allclose(offsets, [states[2] - states[1], states[1] - states[0]], atol=1e-12)
    slopes = np.kron([[0.0, -1.0, 1.0], [-1.0, 1.0, 0.0]], np.eye(3))
    whole = spreads.transpose(0, 2, 1, 3).reshape(6, 6)
    np.testing.assert_allclose(whole, slopes @ joint @ slopes.T, atol=1e-12)
    distance = np.sqrt(offsets[0] @ np.linalg.solve(spreads[0, 0], offsets[0]))
    assert relative_distances(own.component, pairs)[0] == pytest.approx(distance, rel=1e-9)


def test_what_an_understated_drift_began_twice_is_one_again() -> None:
    """Odometry errs by five standard deviations at the turn, after which both points were begun anew."""
    alone, looking = (walked(every, 3.0, 0.25, 0.05) for every in (10**6, 10))
    assert not {0, 1} & {number for step in best(alone)[TURN:] for number in step.association}
    assert all(step.association == (0, 1) for step in best(looking)[TURN + 3 :])
    ((_, live),) = looking.live.items()
    revised = replay_of(looking).followed(live.lineage)
    assert revised is not None
    assert looking.log_evidence == pytest.approx(revised.log_joint, abs=0.1)  # and a little of the former one
    assert looking.log_evidence > alone.log_evidence + 50.0
