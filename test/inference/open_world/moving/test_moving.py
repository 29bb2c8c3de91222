"""Things that move are told from those that stand still by evidence, and neither pull the robot nor leave ghosts."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from worlds.drives.moving_world import STANDING, MovingWorld, configuration, make_world, objects_of, run
from worlds.same_beliefs import assert_same

from semantic_slam.configuration import Configuration
from semantic_slam.contracts.forgetful_pool import ForgetfulPool
from semantic_slam.errors import InputError
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.building import initial_pose_of, make_run_configuration
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.states.lineage import MOVES

SHARE = 0.1
SEEDS = range(2)
COVARIANCE = np.diag([0.05**2, 0.02**2])


@cache
def driven(seed: int, share: float, movers: bool = True) -> tuple[MovingWorld, Engine, list[HybridBelief]]:
    """A world, the engine after its drive under a share of moving things, and the beliefs."""
    world = make_world(seed=seed, movers=movers)
    return world, *run(world, configuration(share))


def errors(beliefs: list[HybridBelief], truth: np.ndarray) -> np.ndarray:
    """(K,) metres."""
    return np.array([np.hypot(*(own.poses[0, :2] - x[:2])) for own, x in zip(beliefs, truth, strict=True)])


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_what_moves_is_called_moving_and_leaves_no_ghosts(seed: int) -> None:
    world, engine, beliefs = driven(seed, SHARE)
    belief, names = beliefs[-1], objects_of(engine, world)
    moving = belief.object_ids[(belief.moving > 0.9) & (belief.existence > 0.5)].tolist()
    assert sorted(max(set(names[n]), key=names[n].count) for n in moving) == [10, 11]
    stands = (belief.existence > 0.5) & (belief.moving < 0.05)
    away = np.linalg.norm(belief.object_poses[stands, None, :2] - STANDING, axis=-1)
    assert (away.min(axis=1) < 0.3).all() and (away.min(axis=0) < 0.3).all() and len(away) == len(STANDING)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_what_moves_does_not_pull_the_robot(seed: int) -> None:
    world, _, with_movers = driven(seed, SHARE)
    _, _, without = driven(seed, 0.0, movers=False)
    assert errors(with_movers, world.truth).mean() < errors(without, world.truth).mean() + 0.005


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_where_nothing_moves_nothing_is_called_moving(seed: int) -> None:
    known, plain = (driven(seed, share, movers=False)[2][-1] for share in (SHARE, 0.0))
    sure = known.existence > 0.5
    assert (known.moving[sure] < 0.05).all()
    np.testing.assert_allclose(known.object_velocities[sure], 0.0, atol=0.02)
    assert sure.sum() == (plain.existence > 0.5).sum() == len(STANDING)
    np.testing.assert_allclose(known.poses[0], plain.poses[0], atol=1e-3)
    assert not np.isfinite(plain.moving).any()


@pytest.mark.slow
def test_a_velocity_is_known_while_its_object_is_seen() -> None:
    world, engine, beliefs = driven(0, SHARE)
    names = objects_of(engine, world)
    numbers = [n for n, own in names.items() if 10 in own]
    seen = [belief for belief, own in zip(beliefs, world.names, strict=True) if 10 in own][-1]
    row = np.flatnonzero(np.isin(seen.object_ids, numbers) & (seen.moving > 0.9))
    np.testing.assert_allclose(seen.object_velocities[row[0], :2], [0.15, 0.6], atol=0.15)


@pytest.mark.long
@pytest.mark.slow
def test_neither_backends_nor_replays_change_anything() -> None:
    world, settings = make_world(14, seed=1), configuration(SHARE)
    expected = run(world, settings)[1]
    announced = make_run_configuration(settings, None, *initial_pose_of(settings), stamp_ns=0)
    for pool in (InProcessPool(2), ForgetfulPool(2)):
        engine = Engine.of_run(announced, pool)
        for keyframe, belief in zip(world.keyframes, expected, strict=True):
            assert_same(engine.process(keyframe), belief)
    assert any(MOVES in step.class_assignment for live in engine.live.values() for step in live.lineage)


def test_a_label_tells_what_may_move() -> None:
    settings = configuration(0.0)
    settings = Configuration.of(**_values(settings), moving={"share": 0.3, "share_by_label": ["Tree=0", "car=0.6"]})
    engine = Engine(settings)
    detections = [
        Detection(range_m=3.0, bearing_rad=0.5 * n, label=own) for n, own in enumerate(("tree", "CAR", "dog"))
    ]
    belief = engine.process(Keyframe.planar(0, detections=detections))
    drive = 3 / 4  # of what may move, one speed of four is none
    np.testing.assert_allclose(belief.moving, [0.0, drive * 0.6, drive * 0.3])


def _values(settings: Configuration) -> dict[str, Any]:
    return {"association": "open", "semantic_model": {"kind": "none"}, "open_world": {"iterate_updates": False}}


@pytest.mark.long
@pytest.mark.parametrize(("speed_m_s", "moving"), [(0.0, 0.0), (1.0, 1.0)])
def test_what_may_move_and_stands_is_said_to_stand(speed_m_s: float, moving: float) -> None:
    """A second of sights, of which the histories that take it to move never let the robot make use."""
    engine, random = Engine(configuration(0.9, pruning={"ratio": 1e9})), np.random.default_rng(0)
    for k in range(20):
        noise = random.normal(size=2) * np.sqrt(np.diag(COVARIANCE))
        sight = Detection(range_m=2.0 + speed_m_s * k + noise[0], bearing_rad=noise[1], covariance=COVARIANCE)
        belief = engine.process(Keyframe.planar(k, detections=[sight], motion_sigmas=(1e-3,) * 3))
        if speed_m_s * (k + 1) > 5.0:
            break
    held = [own.component.movers for own in engine.pool._backends[0].held.values()]
    first = [own.drives[0] for own in held if own.decided.any()]
    assert first
    np.testing.assert_allclose(first, moving, atol=0.02)
    np.testing.assert_allclose(belief.moving[belief.existence > 0.5], moving, atol=0.02)


def test_what_moves_keeps_what_it_is_called_when_something_else_is_given_up() -> None:
    engine, random = Engine(configuration(0.9, labels=("car", "tree"))), np.random.default_rng(0)
    given_up = 0
    for k in range(14):
        noise = random.normal(size=2) * np.sqrt(np.diag(COVARIANCE))
        sights = [Detection(range_m=2.0 + 0.3 * k + noise[0], bearing_rad=noise[1], covariance=COVARIANCE, label="car")]
        if k == 4:  # a false alarm, where nothing is seen again
            sights.append(Detection(range_m=2.0, bearing_rad=0.6, covariance=COVARIANCE, label="tree"))
        engine.process(Keyframe.planar(k, detections=sights, motion_sigmas=(1e-3,) * 3))
        held = [own.component for own in engine.pool._backends[0].held.values()]
        given_up += any(k > 4 and len(own.objects.ids) == 0 for own in held)
        assert all(number in own.views for own in held for number in own.movers.decided_ids)
    assert given_up and any(own.movers.decided.any() for own in held)


@pytest.mark.long
def test_what_stood_for_long_is_still_known_by_its_place() -> None:
    """What moves is lost after a while out of sight, but not what may and does not."""
    engine, random = Engine(configuration(0.9, pruning={"ratio": 1e9})), np.random.default_rng(0)
    shown = [*range(15), *range(75, 78)]
    for k in range(shown[-1] + 1):
        noise = random.normal(size=2) * np.sqrt(np.diag(COVARIANCE))
        sight = Detection(range_m=2.0 + noise[0], bearing_rad=noise[1], covariance=COVARIANCE)
        turned = np.pi if k in (15, 75) else 0.0  # and looks the other way between
        motion = np.array([0.0, 0.0, turned])
        detections = [sight] if k in shown else []
        engine.process(Keyframe.planar(k, motion=motion, detections=detections, motion_sigmas=(1e-3,) * 3))
    lineage = next(own.lineage for own in engine.live.values() if MOVES in own.lineage[1].class_assignment)
    assert lineage[-1].association == lineage[0].association


@pytest.mark.parametrize("entry", ["car", "car=much", "=0.5", "car=1.5"])
def test_a_share_that_is_none_is_named(entry: str) -> None:
    with pytest.raises(InputError, match="LABEL=SHARE"):
        Engine(Configuration.of(**_values(configuration(0.0)), moving={"share_by_label": [entry]}))


@pytest.mark.parametrize(
    "other", [{"open_world": {"iterate_updates": True}}, {"semantic_model": {"kind": "parametric"}}]
)
def test_where_nothing_can_move_that_is_said(other: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"moving\.share"):
        Engine(Configuration.of(**(_values(configuration(0.0)) | other), moving={"share": 0.1}))


RANGE, BEARING, SIGMAS = 3.0, 0.1, np.array([0.02, 0.005])
DENSITY, DETECTED, CLUTTER, STAY = 1e-3, 0.8, 0.05, 30.0


@pytest.mark.parametrize(("moved_m", "clutter"), [(0.0, 0.05), (0.05, 0.05), (0.4, 0.05), (1.1, 200.0)])
def test_the_evidence_of_two_frames_is_that_of_all_explanations(moved_m: float, clutter: float) -> None:
    """Standing still, moving, or two different things: in closed form, in a region that nothing leaves."""
    settings = Configuration.of(
        association="open",
        semantic_model={"kind": "none"},
        open_world={
            "iterate_updates": False,
            "merge_position_m": 0.0,
            "occluder_radius_m": 0.0,
            "detection_probability": DETECTED,
            "clutter_per_frame": clutter,
            "birth_density": DENSITY,
            "min_range_m": 0.0,
            "max_range_m": 300.0,
            "field_of_view_rad": 6.283185307179586,
            "gate_sigma": 1e3,
        },
        weights={"gate": 1e3},
        pruning={"ratio": 1e300},
        perception={"sigma_range_m": SIGMAS[0], "sigma_bearing_rad": SIGMAS[1]},
        initial_pose={"sigma": [1e-6, 1e-6, 1e-6]},
        moving={"share": SHARE, "speeds_m_s": [0.0, 0.05, 0.4], "steadiness_s": 3.0},
    )
    engine, sure = Engine(settings), [1e-6, 1e-6, 1e-6]
    ranges = [RANGE, RANGE + moved_m]
    for k, reach in enumerate(ranges):
        belief = engine.process(
            Keyframe.planar(k, motion_sigmas=sure, detections=[Detection(range_m=reach, bearing_rad=BEARING)])
        )
    expected = explanations(settings, ranges)
    assert engine.log_evidence == pytest.approx(np.log(sum(expected.values())), abs=2e-3)
    shares = {name: own / sum(expected.values()) for name, own in expected.items()}
    found = {}
    for live in engine.live.values():
        first, second = live.lineage
        same = "moves" if second.class_assignment[0] == MOVES else "stands"
        found[same if second.association == first.association else "other"] = np.exp(live.log_weight)
    for name, share in shares.items():
        assert found.get(name, 0.0) == pytest.approx(share, rel=5e-3, abs=1e-12)
    exists, moves = first_object(settings, ranges, shares)
    assert belief.existence[0] == pytest.approx(exists, rel=5e-3)
    assert belief.moving[0] == pytest.approx(moves, rel=5e-3)


def first_object(settings: Configuration, ranges: list[float], shares: dict[str, float]) -> tuple[float, float]:
    """P(the first object exists), and P(it moves | it exists): one thing, or the first of two, missed since."""
    seen_once = DETECTED * DENSITY / (DETECTED * DENSITY + clutter_density(settings))
    exists_missed = seen_once * (1.0 - DETECTED) / (1.0 - seen_once * DETECTED)
    by_size = sizes(settings, ranges)
    there = {"stands": shares["stands"], "moves": shares["moves"], "other": shares["other"] * exists_missed}
    moves = {"moves": 1.0 - by_size[0] / by_size.sum(), "other": SHARE * 2.0 / 3.0}  # one size of three is 0
    exists = sum(there.values())
    return exists, sum(there[name] * own for name, own in moves.items()) / exists


def clutter_density(settings: Configuration) -> float:
    """False alarms per square metre."""
    return settings.open_world.clutter_per_frame / (np.pi * settings.open_world.max_range_m**2)


def sizes(settings: Configuration, ranges: list[float]) -> np.ndarray:
    """Per metre and radian, the density of the second place of something that moves, by the size of its speed."""
    speeds, steady = np.array(settings.moving.speeds_m_s), settings.moving.steadiness_s
    variances = 2.0 * (speeds * steady) ** 2 * (1.0 / steady + np.expm1(-1.0 / steady))
    across = variances + SIGMAS[1] ** 2 * float(np.sum(np.square(ranges)))
    return ranges[1] * gaussian(ranges[1] - ranges[0], 2.0 * SIGMAS[0] ** 2 + variances) * gaussian(0.0, across)


def gaussian(offset: float, variance: np.ndarray | float) -> np.ndarray:
    return np.exp(-0.5 * offset**2 / np.asarray(variance)) / np.sqrt(2.0 * np.pi * np.asarray(variance))


def explanations(settings: Configuration, ranges: list[float]) -> dict[str, float]:
    """P(Z_1, Z_2, explanation) of one detection in each of two frames, straight ahead of each other."""
    area, clutter = np.pi * settings.open_world.max_range_m**2, clutter_density(settings)
    first = DETECTED * DENSITY + clutter
    exists = DETECTED * DENSITY / first
    unseen = max((1.0 - DETECTED) ** 1, settings.open_world.least_undetected_share)
    second = DETECTED * DENSITY * unseen + clutter
    stands = float(gaussian(ranges[1] - ranges[0], 2.0 * SIGMAS[0] ** 2) * gaussian(0.0, 2.0 * SIGMAS[1] ** 2))
    seen = exists * DETECTED
    expected = np.exp(-2.0 * clutter * area - DETECTED * DENSITY * area * (1.0 + unseen))
    common = expected * first * ranges[0]
    return {
        "stands": common * seen * (1.0 - SHARE) * stands,
        "moves": common * seen * SHARE * float(np.mean(sizes(settings, ranges))),
        "other": common * (1.0 - seen) * second * ranges[1],
    }


def test_a_frame_may_show_nothing_but_what_moves() -> None:
    """More joint assignments than are weighed, and none of them to an object that stands."""
    engine = Engine(configuration(0.5, weights={"max_candidates": 6}))
    for k in range(8):
        places = np.array([[1.5 + 0.4 * k, side] for side in (-1.0, 0.0, 1.0)])
        detections = [
            Detection(range_m=float(np.hypot(*p)), bearing_rad=float(np.arctan2(p[1], p[0])), covariance=COVARIANCE)
            for p in places
        ]
        belief = engine.process(Keyframe.planar(k, detections=detections, motion_sigmas=(1e-3,) * 3))
    sure = belief.existence > 0.5
    np.testing.assert_allclose(belief.moving[sure], 1.0, atol=0.05)
    assert sure.sum() == len(places)


def test_what_is_missed_is_likelier_to_be_fast_and_out_of_view() -> None:
    """One sight, and none a second later: speeds by Bayes' rule, each by how often it would have been missed."""
    slow, fast, reach, elapsed_s = 0.05, 3.0, 3.5, 1.0
    region = {"min_range_m": 0.0, "max_range_m": reach, "field_of_view_rad": 6.283185307179586}
    rates = {"detection_probability": DETECTED, "clutter_per_frame": CLUTTER, "least_undetected_share": 0.0}
    settings = Configuration.of(
        association="open",
        semantic_model={"kind": "none"},
        open_world={"iterate_updates": False, "occluder_radius_m": 0.0, "birth_density": 0.1, **region, **rates},
        initial_pose={"sigma": [1e-6, 1e-6, 1e-6]},
        moving={"share": SHARE, "speeds_m_s": [slow, fast], "steadiness_s": 1e3},
    )
    engine = Engine(settings)
    sight = Detection(range_m=1.5, bearing_rad=0.0, covariance=np.diag([0.01**2, 0.01**2]))
    for k, detections in enumerate(([sight], [])):
        engine.process(Keyframe.planar(k, detections=detections, motion_sigmas=(1e-6,) * 3))
    (held,) = engine.pool._backends[0].held.values()
    random, places = np.random.default_rng(0), np.array([1.5, 0.0])
    ends = [places + elapsed_s * speed * random.standard_normal((100_000, 2)) for speed in (slow, fast)]
    missed = np.array([1.0 - DETECTED * (np.hypot(*end.T) < reach).mean() for end in ends])
    np.testing.assert_allclose(np.exp(held.component.movers.log_speeds[0]), missed / missed.sum(), atol=0.02)
