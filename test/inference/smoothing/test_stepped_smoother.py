"""A smoother with one update per keyframe, where it holds its measurements linear: against the optimum of them all."""

import gtsam
import numpy as np
import pytest
from worlds.exact.exact_graph import estimate_of, exact_graph

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.planar.observation import PlanarObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.smoothing.linear.linear_measurements import LinearMeasurements
from semantic_slam.inference.smoothing.linear.measured import Measured, Motions, Sightings
from semantic_slam.inference.smoothing.linear.new_measurements import linearised_at_once
from semantic_slam.inference.smoothing.semantic_factors import SemanticFactorMaker
from semantic_slam.inference.smoothing.smoother import Smoother
from semantic_slam.inference.states.keys import error_keys, error_place, object_key, robot_key
from semantic_slam.inference.states.kinds.planar_poses import PlanarPoses
from semantic_slam.inference.states.spaces import Spaces

SPACES = Spaces.same(PlanarPoses())
MODEL = PlanarObservation(None, PlanarVisibility())
MAKER = SemanticFactorMaker(SPACES, MODEL, None)
KEYFRAMES = 40
STEP = np.array([0.5, 0.0, 2.0 * np.pi / KEYFRAMES])
TURN_SIGMA = 0.03
PLACE_NOISE = np.diag([0.05, 0.02]) ** 2
SCALE, SLOPE = 2.0, 1.5
"""Of residuals that are whitened by what does not repeat, and by what does."""
LOOSE = gtsam.noiseModel.Isotropic.Sigma(3, 10.0)
POSTS = np.array([[1.5, 1.0], [2.0, -0.8]])


def on_a_ring(
    drift_rad: float,
    heading_sigma: float = 1e-3,
    *,
    posts: Array = POSTS,
    turn_sigma: float = TURN_SIGMA,
    swapped: bool = False,
) -> Smoother:
    """Once around, the odometry turning by so much too much in all; two posts are seen at the start and at the end.

    At the end each may be taken for the other one.
    """
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([1e-3, 1e-3, heading_sigma]))
    graph.add(gtsam.PriorFactorPose2(robot_key(-1), gtsam.Pose2(), noise))
    values.insert(robot_key(-1), gtsam.Pose2())
    smoother = Smoother.of(SPACES, MAKER, graph, values).with_single_steps(0, errors_repeat=True)
    true = np.zeros(3)
    for k in range(KEYFRAMES + 3):
        true = se2.compose(true, STEP)
        seen = [detection(se2.between(true, np.array([*post, 0.0]))) for post in posts] if is_seen(k) else []
        told = STEP + np.array([0.0, 0.0, drift_rad / KEYFRAMES])
        ids = [1, 0] if swapped and k >= KEYFRAMES else [0, 1]
        smoother = driven_on(smoother, k, told, turn_sigma, seen, ids)
    return smoother


def is_seen(k: int) -> bool:
    """Whether the posts are seen in a keyframe."""
    return k < 3 or k >= KEYFRAMES


def driven_on(
    smoother: Smoother, k: int, told: Array, turn_sigma: float, seen: list[PlanarDetection], ids: list[int]
) -> Smoother:
    """One keyframe more, with detections of posts by their ``ids``."""
    graph, values, measured = next_keyframe(smoother, k, told, turn_sigma, seen, ids)
    (new,) = linearised_at_once([smoother.with_charts(values, measured)])
    return smoother.stepped(graph, values, [], {}, again=k >= KEYFRAMES, new=new)


def next_keyframe(
    smoother: Smoother, k: int, told: Array, turn_sigma: float, seen: list[PlanarDetection], ids: list[int]
) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values, list[Measured]]:
    """Factors, new variables and measurements of :func:`driven_on`."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    robot = gtsam.Pose2(*smoother.states([robot_key(k - 1)])[0]).compose(gtsam.Pose2(*told))
    values.insert(robot_key(k), robot)
    measured: list[Measured] = [Motions.one(k, told, np.diag([0.05, 0.05, turn_sigma]) ** 2, None)]
    if seen:
        measured.append(sightings(k, seen, ids))
        (key,) = error_keys(k, len(seen))
        values.insert(key, np.zeros(4))
        graph.add(gtsam.PriorFactorVector(key, np.zeros(4), gtsam.noiseModel.Unit.Create(4)))
        for number, own in enumerate(seen if k == 0 else ()):
            point = own.range_m * np.array([np.cos(own.bearing_rad), np.sin(own.bearing_rad)])
            start = gtsam.Pose2(*robot.transformFrom(point), 0.0)
            graph.add(gtsam.PriorFactorPose2(object_key(number), start, LOOSE))
            values.insert(object_key(number), start)
    return graph, values, measured


def detection(place: Array) -> PlanarDetection:
    """Of what is at a place in the body frame."""
    return PlanarDetection(
        range_m=float(np.hypot(*place[:2])),
        bearing_rad=float(np.arctan2(place[1], place[0])),
        covariance=PLACE_NOISE,
        sensor=np.zeros(2),
        feature=np.zeros(0),
        feature_covariance=np.zeros((0, 0)),
    )


def sightings(k: int, seen: list[PlanarDetection], ids: list[int]) -> Sightings:
    """Of posts in a keyframe, each with an error of its own."""
    places = [error_place(k, len(seen), number) for number in range(len(seen))]
    return Sightings(
        scale=np.full(len(seen), SCALE),
        seen=MODEL.collect(seen),
        rows=np.full(len(seen), k + 1),
        ids=np.array(ids),
        by_error=np.full((len(seen), 2), SLOPE),
        keys=np.array([place.key for place in places]),
        firsts=np.array([place.first for place in places]),
        sizes=np.array([place.size for place in places]),
        offset=np.zeros((len(seen), 2)),
    )


@pytest.mark.parametrize("drift_rad", [0.05, 0.5, 1.5])
def test_a_loop_that_closes_ends_at_the_optimum_of_all_factors(drift_rad: float) -> None:
    ring = on_a_ring(drift_rad)
    best = gtsam.LevenbergMarquardtOptimizer(exact_graph(ring), estimate_of(ring)).optimize()
    keys = [robot_key(k) for k in range(KEYFRAMES + 3)]
    expected = np.array([[(pose := best.atPose2(key)).x(), pose.y(), pose.theta()] for key in keys])
    found = ring.states(keys)
    np.testing.assert_allclose(se2.between(expected, found), 0.0, atol=0.02)


@pytest.mark.parametrize(
    ("posts", "turn_sigma", "drift_rad"),
    [
        ([[-3.14, 8.33], [-11.95, 9.36]], 0.05, 0.7),
        ([[5.01, -7.06], [10.24, -4.14]], 0.1, -2.38),
        ([[5.2, 9.89], [10.62, 7.25]], 0.1, -2.25),
    ],
)
def test_posts_that_are_mistaken_for_each_other_do_not_throw_the_estimate_to_and_fro(
    posts: list[list[float]], turn_sigma: float, drift_rad: float
) -> None:
    """Where whole steps to what the linear measurements make of it would never settle."""
    ring = on_a_ring(drift_rad, posts=np.array(posts), turn_sigma=turn_sigma, swapped=True)
    exact, found = exact_graph(ring), estimate_of(ring)
    best = gtsam.LevenbergMarquardtOptimizer(exact, found).optimize()
    assert exact.error(found) == pytest.approx(exact.error(best), rel=0.01)


def test_a_loop_that_cannot_close_is_not_lost_for_being_stiff() -> None:
    ring = on_a_ring(2.5, turn_sigma=0.003)
    assert np.isfinite(ring.states([robot_key(k) for k in range(KEYFRAMES + 3)])).all()


@pytest.mark.parametrize("drift_rad", [0.05, 1.5])
def test_covariances_are_in_the_tangent_spaces_at_the_estimate(drift_rad: float) -> None:
    """Wherever the charts are that iSAM2 keeps."""
    ring = on_a_ring(drift_rad)
    keys = [robot_key(KEYFRAMES + 2), object_key(0), robot_key(10)]
    exact = gtsam.Marginals(exact_graph(ring), estimate_of(ring))
    expected = exact.jointMarginalCovariance(keys)
    blocks = np.block([[expected.at(one, other) for other in keys] for one in keys])
    found = ring.joint_covariance(keys)
    sigmas = np.sqrt(np.diagonal(blocks))
    np.testing.assert_allclose(found / np.outer(sigmas, sigmas), blocks / np.outer(sigmas, sigmas), atol=0.02)


@pytest.mark.parametrize("drift_rad", [0.05, 0.5, 1.5])
def test_nothing_tells_of_the_heading_of_the_whole_map(drift_rad: float) -> None:
    """However often measurements were made linear, and wherever."""
    smoother = on_a_ring(drift_rad, heading_sigma=0.3)
    assert np.sqrt(smoother.joint_covariance([robot_key(-1)])[2, 2]) == pytest.approx(0.3, rel=5e-3)


def test_a_robot_that_sees_nothing_is_linearised_anew_as_well() -> None:
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(gtsam.PriorFactorPose2(robot_key(-1), gtsam.Pose2(), gtsam.noiseModel.Isotropic.Sigma(3, 1e-3)))
    values.insert(robot_key(-1), gtsam.Pose2())
    smoother = Smoother.of(SPACES, MAKER, graph, values).with_single_steps(0, errors_repeat=True)
    values = gtsam.Values()
    values.insert(robot_key(0), gtsam.Pose2(1.0, 1.0, 1.0))
    motion = Motions.one(0, STEP, np.diag([0.05, 0.05, TURN_SIGMA]) ** 2, None)
    (new,) = linearised_at_once([smoother.with_charts(values, [motion])])
    smoother = smoother.stepped(gtsam.NonlinearFactorGraph(), values, [], {}, again=True, new=new)
    np.testing.assert_allclose(smoother.states([robot_key(0)])[0], STEP, atol=1e-6)


def test_measurements_of_several_smoothers_are_linearised_as_those_of_each_alone() -> None:
    """To the bit: hypotheses are shared out among processes."""
    new, k = [], KEYFRAMES + 3
    for drift_rad, count in ((0.05, 2), (0.5, 1), (1.5, 2)):
        ring, seen = on_a_ring(drift_rad), [detection(np.array([*post, 0.0])) for post in POSTS[:count]]
        _, values, measured = next_keyframe(ring, k, STEP, TURN_SIGMA, seen, list(range(count)))
        new.append(ring.with_charts(values, measured))
    for own, together in zip(new, linearised_at_once(new), strict=True):
        (alone,) = linearised_at_once([own])
        assert len(alone.made) == len(together.made) == 2
        for one, other in zip(alone.made, together.made, strict=True):
            assert one.of is other.of
            for name in ("by_first", "by_second", "constant", "slots"):
                np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_a_map_that_moves_as_a_whole_bends_nothing() -> None:
    linear = on_a_ring(0.05).in_charts
    assert linear is not None
    for own in linear.joined:
        begun = own.of.measured(SPACES, MODEL, *own.of.sides(linear.charts.begun()))
        own = LinearMeasurements.made(own.of, begun, begun)
        steps = np.concatenate([shift_of(points) for points in (linear.charts.objects, linear.charts.robots)])
        moved = linear.charts.located(steps.ravel())
        np.testing.assert_allclose(own.off(own.of.measured(SPACES, MODEL, *own.of.sides(moved))), 0.0, atol=1e-9)


def shift_of(points: Array) -> Array:
    """(n, 3) steps of poses (n, 3) by 100 m along both axes of the map."""
    cos, sin = np.cos(points[:, 2]), np.sin(points[:, 2])
    return np.stack([100.0 * (cos + sin), 100.0 * (cos - sin), 0.0 * cos], axis=1)


def test_measurements_are_in_the_slots_that_they_have_in_isam2() -> None:
    ring = on_a_ring(0.5)
    held, linear = ring.isam.getFactorsUnsafe(), ring.in_charts
    assert linear is not None
    assert held.size() == linear.num_slots
    for own in linear.joined:
        for (first, second, repeated), slot in zip(own.of.terms(), own.slots.tolist(), strict=True):
            assert list(held.at(slot).keys()) == [first, second, *repeated[:1]]
