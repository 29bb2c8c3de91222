"""A robot that is carried in mid-drive, of which odometry tells nothing, is found where it was set down."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from worlds.same_beliefs import assert_same
from worlds.scenes.lost_world import PLACES, STEP, LostWorld, configuration, errors, make_world, map_of

from semantic_slam import Engine
from semantic_slam.configuration import Configuration
from semantic_slam.geometry import se2
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.hypotheses import Hypothesis
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.kept_steps import KeptSteps
from semantic_slam.inference.relocation.places import Account
from semantic_slam.inference.relocation.recovery import Recovery
from semantic_slam.inference.revision.replay import Replay
from semantic_slam.inference.states.lineage import LineageStep
from semantic_slam.inference.world.carried import FIRST_POINT, SOON, is_carried_lately

START, THERE = np.array([4.0, -7.0, 1.9]), np.array([-1.0, -3.0, 0.4])
BEFORE, AFTER = 5, 6
KNOWN = {"initial_pose": {"mean": START.tolist(), "sigma": [0.01, 0.01, 0.01]}}
MAY_BE = {"revision": {"carried_probability": 1e-3, "carried_m": 5.0}}
CARRIED = {**MAY_BE, **KNOWN}
TRIANGLE = np.array([[3.0, 1.0], [6.0, 2.0], [1.0, 3.0]])
ONE = np.array([[3.0, -2.0]])
NOTHING = np.full((1, 2), 99.0)


def carried_world(places: np.ndarray = PLACES, before: int = BEFORE) -> LostWorld:
    """A drive, and another one from elsewhere that goes on with it."""
    worlds = make_world(START, before, places=places), make_world(THERE, AFTER, places=places, seed=1)
    first, second = (own.keyframes for own in worlds)
    apart_ns = first[1].stamp_ns - first[0].stamp_ns
    moved = [replace(own, index=own.index + before, stamp_ns=own.stamp_ns + before * apart_ns) for own in second]
    truth = np.concatenate([own.truth for own in worlds])
    return LostWorld([*first, *moved], truth, [*worlds[0].names, *worlds[1].names])


def driven(settings: Configuration, backends: int = 1) -> tuple[Engine, list[HybridBelief]]:
    engine = Engine(settings, map_of(), backends=backends)
    return engine, [engine.process(keyframe) for keyframe in carried_world().keyframes]


def is_found(belief: HybridBelief) -> bool:
    near = errors(belief, carried_world().truth[belief.keyframe]) < 0.3
    return bool(np.exp(belief.log_weights[near]).sum() > 0.9)


@pytest.fixture(scope="module")
def in_open_world() -> tuple[Engine, list[HybridBelief]]:
    return driven(configuration(**CARRIED))


def assert_found(engine: Engine, beliefs: list[HybridBelief]) -> None:
    assert is_found(beliefs[BEFORE - 1]) and not is_found(beliefs[BEFORE])
    assert is_found(beliefs[-1])
    best = next(iter(engine.live.values()))
    assert [k for k, step in enumerate(best.lineage) if k and step.lattice_point] == [BEFORE]


@pytest.mark.long
def test_a_kidnapped_robot_is_localised_where_it_was_set_down(in_open_world: tuple[Engine, list[HybridBelief]]) -> None:
    assert_found(*in_open_world)


@pytest.mark.long
@pytest.mark.slow
def test_a_kidnapped_robot_is_localised_in_a_closed_world() -> None:
    assert_found(*driven(Configuration.of(association="enumerated", semantic_model={"kind": "none"}, **CARRIED)))


@pytest.mark.long
def test_a_kidnapped_robot_may_stand_anywhere_about_a_single_object() -> None:
    closed = Configuration.of(association="enumerated", semantic_model={"kind": "none"}, **CARRIED)
    world, engine = carried_world(ONE), Engine(closed, map_of(ONE))
    last = [engine.process(keyframe) for keyframe in world.keyframes][-1]
    assert engine.carried > 0.99
    around = last.poses[:, :2] - ONE[0]
    np.testing.assert_allclose(np.hypot(*around.T), np.hypot(*(world.truth[-1, :2] - ONE[0])), atol=0.3)
    assert np.exp(last.log_weights).max() < 0.5
    mean = np.exp(last.log_weights) @ around
    assert np.exp(last.log_weights) @ ((around - mean) ** 2).sum(axis=1) > 1.0


def once_wrong(world: LostWorld, at: int) -> list[Keyframe]:
    """The drive with all bearings of one keyframe off by a third of a radian."""
    seen = world.keyframes[at].measurements
    wrong = replace(seen, bearings_rad=seen.bearings_rad + 0.35)
    return [replace(own, measurements=wrong) if own.index == at else own for own in world.keyframes]


def looks_of(engine: Engine, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Keyframes before which it is looked where the robot may have been carried, as they come."""
    found, look = [], Recovery._look

    def noted(own: Recovery, since: int, live: Mapping[int, Hypothesis]) -> None:
        if own is engine.recovery:
            found.append(since)
        look(own, since, live)

    monkeypatch.setattr(Recovery, "_look", noted)
    return found


@pytest.mark.long
def test_searching_for_a_kidnapping_does_not_change_the_belief_of_a_robot_that_stayed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    keyframes = once_wrong(make_world(START, 10, places=TRIANGLE), 3)
    closed = {"association": "enumerated", "semantic_model": {"kind": "none"}, **KNOWN}
    engines = [Engine(Configuration.of(**closed, **own), map_of(TRIANGLE)) for own in ({}, MAY_BE)]
    looks = looks_of(engines[1], monkeypatch)
    for keyframe in keyframes:
        assert_same(*(engine.process(keyframe) for engine in engines))
    assert looks


@pytest.mark.long
def test_what_did_not_fit_long_ago_is_no_longer_looked_at_first(monkeypatch: pytest.MonkeyPatch) -> None:
    world = carried_world(before=50)
    closed = Configuration.of(association="enumerated", semantic_model={"kind": "none"}, **CARRIED)
    engine = Engine(closed, map_of())
    looks = looks_of(engine, monkeypatch)
    for keyframe in once_wrong(world, 5):
        engine.process(keyframe)
    assert looks[:2] == [5, 50]


def test_histories_that_have_seen_the_same_are_one_only_near_each_other() -> None:
    lineage = (LineageStep((3,), (-1,)), LineageStep((3,), (-1,)).with_lattice_point(7))
    here, beside, away = (Account.of(lineage, START + np.array([x, 0.0, 0.0])) for x in (0.0, 0.2, 2.0))
    turned = Account.of(lineage, START + np.array([0.0, 0.0, 1.0]))
    assert here.is_like(beside) and not here.is_like(away) and not here.is_like(turned)
    assert not here.is_like(Account.of((lineage[0], LineageStep((3,), (-1,))), START))


@pytest.mark.long
@pytest.mark.parametrize(("kind_ratio", "followed"), [(1.0, 0), (1e300, 1)])
def test_hypotheses_of_a_robot_that_stayed_are_given_up_later_than_all_others(kind_ratio: float, followed: int) -> None:
    """Models that are a little wrong may say for some keyframes that it was carried; then what was so leads again."""
    engine = Engine(configuration(**CARRIED, pruning={"kind_ratio": kind_ratio, "max_hypotheses": 4}), map_of())
    for keyframe in carried_world().keyframes:
        engine.process(keyframe)
    assert engine.carried > 0.99
    assert [any(step.lattice_point for step in own.lineage) for own in engine.live.values()].count(False) == followed


def test_who_is_never_carried_is_not_found_again() -> None:
    _, beliefs = driven(configuration(**KNOWN))
    assert not is_found(beliefs[-1])


@pytest.mark.long
@pytest.mark.slow
def test_backends_that_rebuild_such_a_history_believe_the_same(
    in_open_world: tuple[Engine, list[HybridBelief]],
) -> None:
    for one, two in zip(in_open_world[1], driven(configuration(**CARRIED), backends=2)[1], strict=True):
        assert_same(one, two)


def test_such_a_history_weighs_what_the_integral_over_all_places_does() -> None:
    """Three points of the map after it was carried: P(Z) = p / (1 - p) int p(x) L(x) dx, relative to before."""
    engine = Engine(configuration(rates={"birth_density": 1e-9, "clutter_per_frame": 0.0}, **CARRIED), map_of(TRIANGLE))
    before = make_world(START, 1, places=NOTHING)
    after = make_world(np.array([4.0, -3.0, 2.0]), 1, places=TRIANGLE, seed=3)
    keyframes = [before.keyframes[0], replace(after.keyframes[0], index=1, stamp_ns=2 * 10**9)]
    association = engine.association(engine.problem, engine.registry)
    steps = [engine.problem.reader.step(keyframe) for keyframe in keyframes]
    for step in steps:
        association.introduce(engine.registry, step)
    replay, carried = Replay(engine.problem, association, KeptSteps(steps)), engine.problem.carried
    (names,) = after.names
    assert carried is not None and len(names) == 3
    first = LineageStep((), ())
    begun = replay.before((first,), 1)
    robot = se2.compose(START, STEP)
    point = carried.point(se2.between(robot, after.truth[0]))
    assert begun is not None and point is not None
    found = replay.followed((first, LineageStep(names, (-1, -1, -1)).with_lattice_point(point)))
    assert found is not None
    odds = np.log(1e-3 / (1.0 - 1e-3)) + 3.0 * np.log(0.9)
    expected = odds + _by_grid(robot, after.truth[0], steps[1].detections, TRIANGLE[list(names)])
    assert found.log_joint - begun.log_joint == pytest.approx(expected, abs=0.15)


def _by_grid(robot: np.ndarray, centre: np.ndarray, detections: list, places: np.ndarray) -> float:
    """Log of the integral over poses about ``centre``, of being carried there from ``robot`` times the detections'."""
    axes = [np.linspace(-w, w, 41) for w in (0.3, 0.3, 0.1)]
    poses = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3) + centre
    away = poses[:, :2] - robot[:2]
    total = -0.5 * (away**2).sum(axis=1) / 25.0 - np.log(2.0 * np.pi * 25.0) - np.log(2.0 * np.pi)
    for detection, place in zip(detections, places, strict=True):
        offset = place - poses[:, :2]
        off_range = detection.range_m - np.hypot(*offset.T)
        off_bearing = wrap_angle(detection.bearing_rad - np.arctan2(offset[:, 1], offset[:, 0]) + poses[:, 2])
        variances = np.diag(detection.covariance) + np.array([1e-4, 0.0])  # a point of the map is known to a centimetre
        total += -0.5 * (off_range**2 / variances[0] + off_bearing**2 / variances[1])
        total -= 0.5 * np.log((2.0 * np.pi) ** 2 * variances.prod())
    volume = float(np.prod([axis[1] - axis[0] for axis in axes]))
    return float(np.logaddexp.reduce(total) + np.log(volume))


@pytest.mark.parametrize("at", [0, 1, 2, 7])
@pytest.mark.parametrize("length", [1, 2, SOON, SOON + 1, SOON + 9])
def test_carried_lately_is_within_the_last_steps_and_the_first_step_is_a_start(at: int, length: int) -> None:
    stays, moved = LineageStep((), ()), LineageStep((), ()).with_lattice_point(FIRST_POINT)
    lineage = tuple(moved if k == at else stays for k in range(length))
    assert is_carried_lately(lineage) == (0 < at < length <= at + SOON)
