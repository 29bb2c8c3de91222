"""Flights of several horizons: as with the whole graph, with a bounded number of variables, and to the bit again."""

import gtsam
import numpy as np
import pytest
from worlds.same_beliefs import assert_same
from worlds.scenes.rounds import ROUND, START_SIGMAS, Rounds

from semantic_slam import Configuration, Engine, HybridBelief, MapPrior, ObjectPrior
from semantic_slam.contracts.forgetful_pool import ForgetfulPool
from semantic_slam.geometry import se3
from semantic_slam.inference.building.announcement import make_run_configuration
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.keys import is_object, robot_key

HORIZON = 20
SURE = {"closed_world": {"wrong_identity_share": 0.0}}
REGION = {
    "birth_density": 0.3,
    "occluder_radius_m": 0.05,
    "clutter_per_frame": 0.01,
    "max_range_m": 4.0,
    "field_of_view_rad": 1.4,
    "vertical_field_of_view_rad": 1.4,
}


def configured(horizon: int, **values: object) -> Configuration:
    """Of points alone."""
    told = {"observation": "points", "semantic_model": {"kind": "none"}, "open_world": REGION, **SURE, **values}
    return Configuration.of(state_space="spatial", history={"horizon_keyframes": horizon}, **told)


def flown(flight: Rounds, engine: Engine, count: int) -> HybridBelief:
    """The belief after the first keyframes of a flight."""
    for keyframe in flight.keyframes(count):
        belief = engine.process(keyframe)
    return belief


def engine_of(horizon: int, **values: object) -> Engine:
    return Engine(
        configured(horizon, **values),
        initial_pose=Rounds.pose(0),
        initial_covariance=np.diag(START_SIGMAS**2),
    )


def heaviest(engine: Engine) -> Component:
    return engine.pool.component(next(iter(engine.live)))  # type: ignore[attr-defined]


@pytest.mark.long
@pytest.mark.parametrize("association", ["given", "open"])
def test_a_flight_with_depth_is_known_as_with_the_whole_graph(association: str) -> None:
    """Pose and places to 0.15 standard deviations, and as surely to 4 %, existence as well; iSAM2 itself errs so."""
    named, count = association == "given", 2 * HORIZON
    ours, whole = (
        (engine, flown(Rounds(0, 6, has_depth=True, are_named=named), engine, count))
        for engine in (engine_of(horizon, association=association) for horizon in (HORIZON, 0))
    )
    (engine, belief), (_, expected) = ours, whole
    assert heaviest(engine).smoother.num_variables <= HORIZON * 1.25 + len(belief.object_ids)
    assert len(heaviest(engine).path()) == count
    shift, ratio = compared(belief, expected)
    assert shift < 0.15
    assert min(ratio) > 0.96 and max(ratio) < 1.04
    np.testing.assert_allclose(belief.existence, expected.existence, atol=1e-3)
    np.testing.assert_allclose(belief.log_weights, expected.log_weights, atol=1e-2)


def compared(ours: HybridBelief, whole: HybridBelief) -> tuple[float, tuple[float, float]]:
    """Largest shift of a mean, in standard deviations, and least and largest ratio of a standard deviation."""
    np.testing.assert_array_equal(ours.object_ids, whole.object_ids)
    off = se3.log(se3.between(whole.poses[0], ours.poses[0]))
    spread, expected = (se3.covariance_at_pose(own.poses[0], own.pose_covariances[0]) for own in (ours, whole))
    sigmas = np.sqrt(np.diagonal(whole.object_covariances[:, :3, :3], axis1=1, axis2=2))
    ratios = np.sqrt(np.diagonal(ours.object_covariances[:, :3, :3], axis1=1, axis2=2)) / sigmas
    shifts = np.abs(ours.object_poses[:, :3] - whole.object_poses[:, :3]) / sigmas
    ratio = np.append(ratios, np.sqrt(np.diagonal(spread) / np.diagonal(expected)))
    return float(max(shifts.max(), np.abs(off / np.sqrt(np.diagonal(expected))).max())), (ratio.min(), ratio.max())


@pytest.mark.long
def test_objects_whose_attitude_nobody_measures_are_known_as_with_the_whole_graph() -> None:
    """Of geometry alone their places are known, and their headings not at all."""
    settings = {"association": "given", "observation": "range_bearing"}
    engines = [engine_of(horizon, **settings) for horizon in (HORIZON, 0)]
    found = [flown(Rounds(4, 4, has_depth=True, are_named=True), engine, HORIZON + 13) for engine in engines]
    shift, ratio = compared(*found)
    assert shift < 0.1
    assert min(ratio) > 0.96 and max(ratio) < 1.04


KNOWN = 0.1
"""Largest standard deviation of an object's place, as a share of its distance from the middle of the room."""


@pytest.mark.long
def test_points_seen_by_rays_alone_are_known_as_at_the_optimum_of_the_whole_graph() -> None:
    """That of iSAM2 is farther from it than the bounded one's."""
    count = HORIZON + ROUND
    engines = [engine_of(horizon, association="given") for horizon in (HORIZON, 0)]
    for engine in engines:
        flown(Rounds(1, 14, has_depth=False, are_named=True), engine, count)
    (ours, here), (graph, there) = (graph_of(engine) for engine in engines)
    best = gtsam.LevenbergMarquardtOptimizer(graph, there).optimize()
    found, whole = gtsam.Marginals(ours, here), gtsam.Marginals(graph, best)
    shifts, ratios = [], []
    for key in [robot_key(count - 1), *filter(is_object, here.keys())]:
        expected = whole.marginalCovariance(key)
        if is_object(key) and np.sqrt(np.linalg.eigvalsh(expected)[-1]) > KNOWN * np.linalg.norm(best.atPoint3(key)):
            continue
        off = here.atPoint3(key) - best.atPoint3(key) if is_object(key) else _apart(best, here, key)
        axes = np.linalg.eigh(expected)[1].T
        sigmas = np.sqrt(np.diagonal(axes @ expected @ axes.T))
        shifts.extend(np.abs(axes @ off) / sigmas)
        ratios.extend(np.sqrt(np.diagonal(axes @ found.marginalCovariance(key) @ axes.T)) / sigmas)
    assert len(shifts) >= 6 + 3 * 8
    assert max(shifts) < 0.2
    assert min(ratios) > 0.95 and max(ratios) < 1.05


def _apart(one: gtsam.Values, other: gtsam.Values, key: int) -> np.ndarray:
    return np.asarray(one.atPose3(key).localCoordinates(other.atPose3(key)))


def graph_of(engine: Engine) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """The factors of the heaviest hypothesis, and its estimate."""
    held, graph = heaviest(engine).smoother.isam.getFactorsUnsafe(), gtsam.NonlinearFactorGraph()
    for slot in range(held.size()):
        if held.exists(slot):
            graph.add(held.at(slot))
    return graph, heaviest(engine).smoother.isam.calculateEstimate()


@pytest.mark.long
@pytest.mark.parametrize("association", ["given", "open"])
def test_a_lineage_of_rays_is_rebuilt_from_a_checkpoint_to_the_bit(association: str) -> None:
    """A backend is lost after a marginalisation: the other one makes its hypotheses anew."""
    count = 28
    run = make_run_configuration(
        configured(HORIZON, association=association), None, Rounds.pose(0), np.diag(START_SIGMAS**2), stamp_ns=0
    )
    beliefs, forgetful = [], ForgetfulPool(2, dies_at=count - 1)
    for pool in (InProcessPool(2), forgetful):
        flight = Rounds(2, 3, has_depth=False, are_named=association == "given")
        beliefs.append(flown(flight, Engine.of_run(run, pool), count))
    assert_same(beliefs[1], beliefs[0])
    (left,) = forgetful._backends
    assert 0 < left.num_replayed < HORIZON * left.num_rebuilt


def test_a_given_map_is_flown_through_for_long() -> None:
    """Which point is which is enumerated."""
    places = Rounds(3, 5, has_depth=True, are_named=False).points
    points = MapPrior(tuple(ObjectPrior.point(n, place, sigma_m=0.1) for n, place in enumerate(places)))
    found = []
    for horizon in (HORIZON, 0):
        engine = Engine(
            configured(horizon, association="enumerated"),
            points,
            initial_pose=Rounds.pose(0),
            initial_covariance=np.diag(START_SIGMAS**2),
        )
        found.append(flown(Rounds(3, 5, has_depth=True, are_named=False), engine, HORIZON + 12))
    shift, ratio = compared(*found)
    assert shift < 0.1
    assert min(ratio) > 0.96 and max(ratio) < 1.04


@pytest.mark.parametrize("observation", ["points", "range_bearing"])
def test_a_flight_that_sees_nothing_is_told_from_its_start(observation: str) -> None:
    engine = engine_of(HORIZON, association="given", observation=observation)
    flight = Rounds(5, 0, has_depth=True, are_named=True)
    flown(flight, engine, HORIZON + 6)
    assert heaviest(engine).oldest == 5
    assert heaviest(engine).smoother.num_variables == HORIZON + 1
    motions = [keyframe.odometry for keyframe in Rounds(5, 0, has_depth=True, are_named=True).keyframes(HORIZON + 6)]
    expected = Rounds.pose(0)
    for found, motion in zip(heaviest(engine).path(), motions, strict=True):
        expected = se3.compose(expected, motion)
        np.testing.assert_allclose(se3.log(se3.between(expected, found)), 0.0, atol=1e-6)
