"""Names that come with detections, in an open world: a strong prior on what each is of, and no fact."""

import itertools
from dataclasses import replace

import gtsam
import numpy as np
import pytest
from scipy.stats import multivariate_normal
from worlds.drives.open_room import OBJECTS, Room, make_room
from worlds.exact.exact_graph import estimate_of, exact_graph
from worlds.same_beliefs import assert_same

from semantic_slam import Detection, Engine, Keyframe
from semantic_slam.configuration import load_configuration
from semantic_slam.contracts.forgetful_pool import ForgetfulPool
from semantic_slam.geometry import se2
from semantic_slam.geometry.pose import planar_from_covariance, planar_from_pose_vector, wrap_angle
from semantic_slam.inference.association.given import GivenAssociation
from semantic_slam.inference.association.strategy import strategy_of
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.open_world.joint.linear_evidence import JointInnovation
from semantic_slam.inference.open_world.named.association import NamedAssociation
from semantic_slam.inference.open_world.named.wrong_names import right_names
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.shipped import configuration_file

SINGLE_STEPS = {"iterate_updates": False}
ERRORS = {"correlated_share": 0.9, "neighbour_m": 0.5, "motion_m": 1.0, "motion_rad": 1.0}
BIASED = {"estimate_bias": True, "sigma_bias_rad_per_m": 0.05, "sigma_bias_scale": 0.05}


def named_room(num_keyframes: int = 20, seed: int = 0, **overrides: object) -> Room:
    """A room without false alarms, whose detections carry the names of their objects."""
    overrides = {"open_world": SINGLE_STEPS, "association": "given"} | overrides
    room = make_room(num_keyframes, seed, clutter=0.0, **overrides)
    return with_names(room, [tuple(f"piece_{n}" for n in own) for own in room.associations])


def with_names(room: Room, names: list[tuple[str, ...]]) -> Room:
    keyframes = [
        replace(own, measurements=replace(own.measurements, track_ids=told))
        for own, told in zip(room.keyframes, names, strict=True)
    ]
    return replace(room, keyframes=keyframes)


def names_of(room: Room) -> list[tuple[str, ...]]:
    return [own.measurements.track_ids for own in room.keyframes]


def driven(room: Room) -> tuple[list[HybridBelief], Engine]:
    engine = Engine.of_run(room.run, InProcessPool(1))
    return [engine.process(keyframe) for keyframe in room.keyframes], engine


def with_a_wrong_name(room: Room, after: int) -> tuple[Room, tuple[int, int]]:
    """One name replaced by that of an object that was seen before and is not in view; and which detection's it is."""
    names = names_of(room)
    for k in range(after, len(names)):
        known = {name for own in names[:k] for name in own}
        others = sorted(known - set(names[k]))
        if others and len(names[k]) > 1 and names[k][0] in known:
            wrong = (others[0], *names[k][1:])
            return with_names(room, [*names[:k], wrong, *names[k + 1 :]]), (k, 0)
    raise AssertionError("no keyframe that suits")


def errors_of(room: Room, beliefs: list[HybridBelief]) -> np.ndarray:
    """(K,) distances of the best hypothesis from the truth."""
    poses = np.array([planar_from_pose_vector(belief.poses[0]) for belief in beliefs])
    return np.hypot(*(poses - room.truth)[:, :2].T)


def test_one_override_makes_numbers_given_of_the_configuration_for_a_robot_nobody_calibrated() -> None:
    base = load_configuration(configuration_file("uncalibrated"))
    told = replace(base, association="given")
    engine = Engine(told)
    seen = [Detection(range_m=2.0, bearing_rad=0.1, track_id="7"), Detection(bearing_rad=0.0)]
    belief = engine.process(Keyframe.planar(0, detections=seen))
    assert strategy_of(told) is NamedAssociation
    noises = len(base.odometry.noise_factors) * len(base.perception.noise_factors) * len(base.perception.ranges_are)
    assert len(belief.hypotheses) == noises  # one for each: nothing is missed, so that nothing else is to choose
    assert [known.name for known in belief.objects] == ["7"]
    assert belief.associations.tolist() == [[0, -1]] * noises
    np.testing.assert_allclose(belief.existence, 1.0, atol=1e-12)


def test_updates_that_are_iterated_leave_numbers_to_the_closed_world() -> None:
    base = load_configuration(configuration_file("default"))
    assert strategy_of(replace(base, association="given")) is GivenAssociation


def test_the_belief_with_names_is_the_closed_worlds_where_all_is_nearly_linear() -> None:
    """States to a millimetre, to which one update is back-substituted; covariances to 2 % of a variance."""
    upright = {"sigma_heading_rad": 0.01}  # a heading that is not known bends what the closed world integrates over
    rooms = [named_room(12, 3, open_world={"iterate_updates": own}, new_objects=upright) for own in (False, True)]
    (mine, engine), (closed, other) = (driven(fine(room)) for room in rooms)
    for one, two in zip(mine, closed, strict=True):
        assert one.object_names == two.object_names
        np.testing.assert_array_equal(one.object_ids, two.object_ids)
        np.testing.assert_array_equal(one.associations[0], two.associations[0])
        np.testing.assert_allclose(one.poses, two.poses, atol=1e-3)
        np.testing.assert_allclose(one.object_poses[:, :3], two.object_poses[:, :3], atol=1e-3)
        spreads = [planar_from_covariance(own.pose_covariances[0]) for own in (one, two)]
        sigmas = np.sqrt(np.diag(spreads[1]))
        np.testing.assert_allclose(*(own / np.outer(sigmas, sigmas) for own in spreads), atol=0.02)
        np.testing.assert_allclose(one.outlier_probability, two.outlier_probability, atol=1e-4)
    assert engine.log_evidence == pytest.approx(other.log_evidence, abs=0.05)


def fine(room: Room) -> Room:
    """The same drive measured fifty times as well: noise-free places, small covariances."""
    keyframes = []
    for keyframe, truth, seen in zip(room.keyframes, room.truth, room.associations, strict=True):
        d = se2.between(np.broadcast_to(truth, (len(seen), 3)), OBJECTS[list(seen)].reshape(-1, 3))
        covariances = np.tile(np.diag([0.02, 0.004]) ** 2, (len(seen), 1, 1))
        measured = replace(
            keyframe.measurements,
            ranges_m=np.hypot(d[:, 0], d[:, 1]),
            bearings_rad=np.arctan2(d[:, 1], d[:, 0]),
            geometric_covariances=covariances,
        )
        keyframes.append(replace(keyframe, measurements=measured))
    return replace(room, keyframes=keyframes)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("errors", [{"correlated_share": 0.0}, ERRORS], ids=["white", "repeating"])
def test_a_wrong_name_costs_one_detection_and_is_named(errors: dict[str, float]) -> None:
    room = named_room(36, 1, detection_errors=errors)
    swapped, (k, row) = with_a_wrong_name(room, 25)
    (right, _), (wrong, _) = driven(room), driven(swapped)
    assert wrong[k].outlier_probability[row] > 0.99
    assert wrong[k].hypotheses[0].associations[row] == -1
    others = [
        p for n, belief in enumerate(wrong) for i, p in enumerate(belief.outlier_probability) if (n, i) != (k, row)
    ]
    assert max(others) < 0.5
    assert (errors_of(swapped, wrong) - errors_of(room, right)).max() < 0.1
    fact = named_room(36, 1, detection_errors=errors, closed_world={"wrong_identity_share": 0.0})
    believed, _ = driven(with_names(fact, names_of(swapped)))
    assert errors_of(fact, believed)[k:].max() > errors_of(swapped, wrong)[k:].max() + 0.1  # what it is for


def biased_drive(seed: int, num_keyframes: int, **overrides: object) -> Room:
    """Odometry that turns 0.04 rad and 6 % too little for every metre, and ranges that repeat their error by the place.

    Ranges are off by the same decimetre as long as the robot looks at a cluster from about where it is.
    """
    room = named_room(num_keyframes, seed, odometry=BIASED, detection_errors=ERRORS, **overrides)
    random = np.random.default_rng([seed, 5])
    offset, keyframes = 0.0, []
    for keyframe, seen in zip(room.keyframes, room.associations, strict=True):
        left = np.exp(-0.25 - 0.25)
        offset = left * offset + np.sqrt(1.0 - left**2) * random.normal(scale=0.1 * np.sqrt(0.9))
        truth = room.truth[keyframe.index]
        d = se2.between(np.broadcast_to(truth, (len(seen), 3)), OBJECTS[list(seen)].reshape(-1, 3))
        ranges = np.hypot(d[:, 0], d[:, 1]) + offset + random.normal(size=len(seen)) * 0.1 * np.sqrt(0.1)
        step = planar_from_pose_vector(keyframe.odometry)
        told = step * [0.94, 0.94, 1.0] - [0.0, 0.0, 0.04 * step[0]]
        odometry = np.array([told[0], told[1], 0.0, 0.0, 0.0, np.sin(told[2] / 2.0), np.cos(told[2] / 2.0)])
        keyframes.append(
            replace(keyframe, odometry=odometry, measurements=replace(keyframe.measurements, ranges_m=ranges))
        )
    return replace(room, keyframes=keyframes)


@pytest.mark.long
@pytest.mark.slow
def test_numbers_given_find_the_bias_of_a_robot_whose_ranges_repeat_their_errors() -> None:
    nees = []
    for seed in range(2):
        room = biased_drive(seed, 80)
        beliefs, engine = driven(room)
        tracked = next(iter(engine.pool._backends[0].held.values())).component.tracked
        sigmas = np.array([0.05, 0.05])
        found, spread = tracked.bias[:2] * sigmas, np.sqrt(np.diag(tracked.propagated_covariance)[3:5]) * sigmas
        assert (np.abs(found - [0.04, 0.06]) < 3.5 * spread).all()
        assert errors_of(room, beliefs)[-1] < 0.3
        off = planar_from_pose_vector(beliefs[-1].poses[0]) - room.truth[-1]
        off[2] = float(wrap_angle(np.array(off[2])))
        nees.append(off @ np.linalg.solve(planar_from_covariance(beliefs[-1].pose_covariances[0]), off))
    assert np.mean(nees) < 6.0


@pytest.mark.long
def test_single_steps_end_near_the_optimum_of_their_graph_where_errors_repeat() -> None:
    """Half the sum of squared errors is that of a batch solution; made linear as seldom as else it is 7 above it."""
    _, engine = driven(biased_drive(1, 60))
    smoother = engine.pool._backends[0].held[next(iter(engine.live))].component.smoother
    graph, estimate = exact_graph(smoother), estimate_of(smoother)
    optimum = gtsam.LevenbergMarquardtOptimizer(graph, estimate).optimize()
    assert graph.error(estimate) < graph.error(optimum) + 0.5


def test_a_pose_that_is_far_off_is_no_reason_to_doubt_every_name() -> None:
    """A turn that slips by ten sigma puts each detection so far off that one alone would be called wrong."""
    room = named_room(32, 1)
    k = next(k for k in range(25, 32) if len(room.associations[k]) >= 3)
    keyframe = room.keyframes[k]
    slipped = keyframe.odometry.copy()
    slipped[5:] = [np.sin(0.5 * 0.35), np.cos(0.5 * 0.35)]  # 0.25 rad in truth
    keyframes = [*room.keyframes[:k], replace(keyframe, odometry=slipped), *room.keyframes[k + 1 :]]
    beliefs, _ = driven(replace(room, keyframes=keyframes))
    assert max(beliefs[k].outlier_probability) < 0.05
    assert errors_of(room, beliefs)[-1] < 0.3


@pytest.mark.long
def test_of_two_detections_with_one_name_evidence_chooses() -> None:
    room = named_room(30, 1)
    names = names_of(room)
    k = next(k for k in range(25, 30) if len(names[k]) >= 2)
    for kept in range(2):
        doubled = [*names[:k], (names[k][kept],) * 2 + names[k][2:], *names[k + 1 :]]
        beliefs, _ = driven(with_names(room, doubled))
        assert beliefs[k].outlier_probability[kept] < 0.01
        assert beliefs[k].outlier_probability[1 - kept] > 0.99


def test_the_first_detection_of_a_name_is_taken_at_its_word() -> None:
    room = named_room(4, 1)
    names = names_of(room)
    new = ("new", "new", *names[3][2:])
    beliefs, _ = driven(with_names(room, [*names[:3], new]))
    assert beliefs[3].object_names[-1] == "new"
    assert beliefs[3].outlier_probability[:2].tolist() == [0.0, 1.0]


def test_sets_of_right_names_weigh_what_the_joint_gaussian_says() -> None:
    random = np.random.default_rng(0)
    count = 4
    slopes = random.normal(size=(2 * count, 5))
    covariance = np.eye(2 * count) + slopes @ slopes.T
    residual = random.multivariate_normal(np.zeros(2 * count), covariance)
    residual[2:4] += 6.0
    normalisers, log_wrong = random.normal(size=count), random.normal(size=count) - 4.0
    joint = JointInnovation(residual, np.zeros((2 * count, 0)), np.zeros((2 * count, 0)), covariance, list(normalisers))
    objects = np.array([4, 5, 6, 4])
    expected: dict[tuple[bool, ...], float] = {}
    for right in itertools.product([False, True], repeat=count):
        if right[0] and right[3]:
            continue  # of one object
        rows = np.flatnonzero(np.repeat(right, 2))
        total = log_wrong[~np.array(right)].sum() + normalisers[np.array(right)].sum()
        if len(rows):
            total += multivariate_normal(np.zeros(len(rows)), covariance[np.ix_(rows, rows)]).logpdf(residual[rows])
            total += 0.5 * len(rows) * np.log(2.0 * np.pi)
        expected[right] = total
    every = right_names(joint, objects, log_wrong, 100, np.inf)
    found = dict(zip(map(tuple, every.right.tolist()), every.log_scores.tolist(), strict=True))
    assert found == pytest.approx(expected)
    assert every.log_left_out == -np.inf
    few = right_names(joint, objects, log_wrong, 100, 3.0)
    behind = sorted(value - max(expected.values()) for value in expected.values())
    assert len(few.right) == sum(value >= -3.0 for value in behind)
    assert few.log_left_out == pytest.approx(np.logaddexp.reduce([value for value in behind if value < -3.0]))


@pytest.mark.long
def test_a_lineage_with_a_wrong_name_is_rebuilt_to_the_last_bit() -> None:
    room, (k, row) = with_a_wrong_name(named_room(28, 1, odometry=BIASED, detection_errors=ERRORS), 24)
    pools = InProcessPool(2), ForgetfulPool(2, dies_at=k + 1)
    whole, divided = (Engine.of_run(room.run, pool) for pool in pools)
    for keyframe in room.keyframes:
        belief = divided.process(keyframe)
        assert_same(belief, whole.process(keyframe))
        if keyframe.index == k:
            assert belief.outlier_probability[row] > 0.9


def test_noises_of_odometry_are_decided_by_evidence_where_numbers_are_given() -> None:
    factors = {"noise_factors": [1.0, 25.0]}
    beliefs, engine = driven(named_room(30, 2, odometry=factors))
    best = engine.pool._backends[0].held[next(iter(engine.live))].component
    assert best.noise_settings.odometry_factor == 1.0  # the room's odometry is as stated
    assert len(beliefs[0].hypotheses) == 2


@pytest.mark.long
@pytest.mark.parametrize("classes", ["carried", "enumerated"])
def test_views_of_wrong_names_tell_of_no_class(classes: str) -> None:
    room = make_room(
        30, 1, clutter=0.0, semantic=True, association="given", open_world={**SINGLE_STEPS, "classes": classes}
    )
    room = with_names(room, [tuple(f"piece_{n}" for n in own) for own in room.associations])
    swapped, (k, row) = with_a_wrong_name(room, 24)
    beliefs, _ = driven(swapped)
    assert beliefs[k].outlier_probability[row] > 0.9
    assert np.isfinite(beliefs[-1].class_probabilities).all()
