"""Poses of long ago marginalised out: nothing is lost where all is linear, and little where it is not."""

from dataclasses import replace
from typing import Any

import gtsam
import numpy as np
import pytest

from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.models.planar.observation import PlanarObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.smoothing.factor_table import NONE_ADDED
from semantic_slam.inference.smoothing.past.marginalisation import without_past
from semantic_slam.inference.smoothing.past.summary import summary_of
from semantic_slam.inference.smoothing.semantic_factors import SemanticFactorMaker
from semantic_slam.inference.smoothing.smoother import Smoother
from semantic_slam.inference.smoothing.tracking import tracked_before
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.keys import object_key, robot_key
from semantic_slam.inference.states.kinds.planar_poses import PlanarPoses
from semantic_slam.inference.states.kinds.planar_positions import PlanarPositions
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.inference.states.tracked_objects import LOOKS_FROM_A_PLACE

SPACES = Spaces.same(PlanarPositions())
MAKER = SemanticFactorMaker(SPACES, PlanarObservation(None, PlanarVisibility()), None)
POSTS, KEYFRAMES, SEEN_ONCE = 3, 30, 9


def noise(sigma: float) -> Any:
    return gtsam.noiseModel.Isotropic.Sigma(2, sigma)


def walk(*, horizon: int | None) -> Smoother:
    """A point that walks among posts and measures them along map's axes; another post is seen by keyframe 3 alone.

    With a ``horizon`` all but so many poses are summarised after every fifth keyframe.
    """
    random = np.random.default_rng(5)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(gtsam.PriorFactorPoint2(robot_key(-1), np.zeros(2), noise(0.1)))
    values.insert(robot_key(-1), np.zeros(2))
    for number in range(POSTS):
        graph.add(gtsam.PriorFactorPoint2(object_key(number), np.zeros(2), noise(1e3)))
        values.insert(object_key(number), np.zeros(2))
    smoother = Smoother.of(SPACES, MAKER, graph, values)
    for k in range(KEYFRAMES):
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        step = random.normal(size=2)
        graph.add(gtsam.BetweenFactorPoint2(robot_key(k - 1), robot_key(k), step, noise(0.3)))
        graph.add(gtsam.BetweenFactorPoint2(robot_key(k), object_key(k % POSTS), random.normal(size=2), noise(0.2)))
        values.insert(robot_key(k), np.zeros(2))
        if k == 3:
            graph.add(gtsam.BetweenFactorPoint2(robot_key(k), object_key(SEEN_ONCE), np.ones(2), noise(0.2)))
            values.insert(object_key(SEEN_ONCE), np.zeros(2))
        smoother = smoother.updated(graph, values, NONE_ADDED)
        if horizon is not None and k >= horizon and k % 5 == 0:
            smoother = without_past(smoother, k + 1 - horizon, range(POSTS))
    return smoother


def test_in_a_linear_world_a_summary_is_the_whole_graph_without_its_past() -> None:
    whole, ours = walk(horizon=None), walk(horizon=8)
    keys = [robot_key(k) for k in range(KEYFRAMES - 8, KEYFRAMES)] + [object_key(n) for n in range(POSTS)]
    assert ours.states(keys) == pytest.approx(whole.states(keys), abs=1e-9)
    assert ours.joint_covariance(keys) == pytest.approx(whole.joint_covariance(keys), abs=1e-9)
    assert not ours.has(robot_key(0))
    assert not ours.has(object_key(SEEN_ONCE))  # nobody asks for it, and no pose that stays has seen it


def ring() -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """Poses about two posts, of a map that may lie anywhere and turn."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    wide = gtsam.noiseModel.Diagonal.Sigmas(np.array([100.0, 100.0, 10.0]))
    graph.add(gtsam.PriorFactorPose2(robot_key(0), gtsam.Pose2(), wide))
    sharp, pose, step = gtsam.noiseModel.Isotropic.Sigma(3, 0.01), gtsam.Pose2(), gtsam.Pose2(1.0, 0.2, 0.3)
    for k in range(4):
        values.insert(robot_key(k), pose)
        for number in range(2):
            post = gtsam.Pose2(2.0, 3.0 * number - 1.0, 0.5)
            graph.add(gtsam.BetweenFactorPose2(robot_key(k), object_key(number), pose.between(post), sharp))
        if k:
            graph.add(gtsam.BetweenFactorPose2(robot_key(k - 1), robot_key(k), step, sharp))
        pose = pose.compose(step)
    for number in range(2):
        values.insert(object_key(number), gtsam.Pose2(2.0, 3.0 * number - 1.0, 0.5))
    return graph, values


def test_what_turns_the_whole_map_bends_no_summary() -> None:
    graph, values = ring()
    gone, kept = [robot_key(k) for k in range(3)], [robot_key(3), object_key(0), object_key(1)]
    factor = summary_of(Spaces.same(PlanarPoses()), [graph.at(i) for i in range(graph.size())], values, gone).factor(
        Spaces.same(PlanarPoses())
    )
    turn, turned = gtsam.Pose2(3.0, -5.0, 2.0), gtsam.Values()
    for key in kept:
        turned.insert(key, turn.compose(values.atPose2(key)))
    assert factor.error(values) == pytest.approx(0.0, abs=1e-12)
    assert factor.error(turned) < 0.1  # what is known of where the map is: next to nothing
    jacobian, right = factor.linearize(turned).jacobian()
    assert factor.error(turned) == pytest.approx(0.5 * right @ right)
    by_difference = np.empty_like(jacobian)
    for column in range(jacobian.shape[1]):
        step = gtsam.VectorValues()
        for place, key in enumerate(factor.keys()):
            step.insert(key, 1e-6 * np.eye(9)[column, 3 * place : 3 * place + 3])
        by_difference[:, column] = (right - factor.linearize(turned.retract(step)).jacobian()[1]) / 1e-6
    assert jacobian == pytest.approx(by_difference, abs=1e-3)


def configuration(**others: Any) -> Configuration:
    settings: dict[str, Any] = {"association": "given", "semantic_model": {"kind": "none"}, **others}
    return Configuration.of(**settings)


def test_a_horizon_that_something_else_asks_beyond_is_refused() -> None:
    beyond: list[dict[str, Any]] = [
        {"history": {"horizon_keyframes": 5}},
        {"history": {"horizon_keyframes": 100}, "association": "open", "revision": {"every_keyframes": 10}},
        {"history": {"horizon_keyframes": 100}, "semantic_model": {"kind": "latent"}},
        {"history": {"horizon_keyframes": 30}, "association": "open", "revision": {"carried_probability": 1e-3}},
        {
            "history": {"horizon_keyframes": 100},
            "open_world": {"iterate_updates": False},
            "detection_errors": {"correlated_share": 0.5},
        },
    ]
    for others in beyond:
        with pytest.raises(InputError, match=r"history\.horizon_keyframes"):
            Engine(configuration(**others))


def test_a_path_is_told_from_its_start_though_its_beginning_is_summarised() -> None:
    engine = Engine(configuration(history={"horizon_keyframes": 20}))
    for index in range(32):
        engine.process(Keyframe.planar(index, motion=(0.5, 0.0, 0.0)))
    component = engine.pool.component(next(iter(engine.live)))  # type: ignore[attr-defined]
    assert component.oldest == 10
    assert component.path()[:, 0] == pytest.approx(0.5 * np.arange(1, 33), abs=1e-6)


def hypotheses_after(horizon: int) -> list[int]:
    """How many there are after each keyframe of a drive with one detection so far off that its name may be wrong."""
    engine, found = Engine(configuration(history={"horizon_keyframes": horizon})), []
    for k in range(30):
        x, off = 0.2 * k, 0.5 if k == 4 else 0.0
        seen = [Detection.at(3.0 - x + off, 1.5, track_id="a"), Detection.at(4.0 - x, -1.5, track_id="b")]
        belief = engine.process(Keyframe.planar(k, motion=(0.2, 0.0, 0.0), detections=seen))
        found.append(len(belief.hypothesis_ids))
    return found


def test_histories_that_differ_in_what_is_summarised_alone_become_one() -> None:
    assert hypotheses_after(0)[-1] == 2
    counts = hypotheses_after(20)
    assert set(counts[4:24]) == {2}
    assert set(counts[24:]) == {1}


def test_of_a_trail_of_long_ago_the_newest_looks_from_each_place_count() -> None:
    places = np.tile([0.0, 5.0], 50)
    tracked = tracked_before(Spaces.same(PlanarPoses()), GaussianPrior(mean=np.zeros(3), covariance=np.eye(3)), [], 0)
    trail = np.column_stack([places, np.zeros(100), 1e-3 * np.arange(100)])
    thinned = replace(tracked, trail=trail).with_thinned_trail(2).trail
    assert thinned == pytest.approx(trail[-2 * LOOKS_FROM_A_PLACE :])
