"""A hypothesis's whole history: evidence and modes against samples of the prior and finite differences."""

from collections.abc import Sequence

import numpy as np
import pytest
from worlds.scenes.planar_world import make_world

from semantic_slam.configuration import WeightsConfiguration
from semantic_slam.geometry import se2
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.evidence.laplace import Mode
from semantic_slam.inference.evidence.mode_search import SAME_VALLEY, SearchStart, search_modes, valleys
from semantic_slam.inference.evidence.posterior_mode import PosteriorMode
from semantic_slam.inference.evidence.window import Window, WindowStep
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.planar.observation import PlanarObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.models.step import AssociatedDetection, Motion
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.component_update import ComponentUpdate
from semantic_slam.inference.smoothing.growth import certain, grow
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.keys import robot_key
from semantic_slam.inference.states.kinds.planar_poses import PlanarPoses
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.inference.states.tracked_objects import ExistenceUpdate
from semantic_slam.viewpoint.model import Viewpoints
from semantic_slam.viewpoint.parametric import ParametricModel

MANIFOLD = PlanarPoses()
SETTINGS = WeightsConfiguration(importance_samples=8192, gaussian_share=0.9999, max_history=100)
OBJECT = np.array([0.0, 0.0, 0.0])
START = np.array([3.0, 0.0, np.pi])
"""The robot looks at the object from its front, where the class's score is the same on either side."""


def observation(visibility: PlanarVisibility | None = None) -> PlanarObservation:
    return PlanarObservation(ParametricModel(0.5, 15.0), visibility or PlanarVisibility())


def component(model: PlanarObservation, sigma_m: float, sigma_rad: float) -> Component:
    robot = GaussianPrior(START, np.diag([0.01, sigma_m**2, sigma_rad**2]))
    return Component.root(Spaces.same(MANIFOLD), model, robot, {0: GaussianPrior(OBJECT, np.diag([1e-4, 1e-4, 1e-6]))})


def detection(
    model: PlanarObservation, azimuth: float, *, range_m: float = 3.0, bearing: float = 0.0
) -> PlanarDetection:
    """As the robot would make it from ``azimuth`` [rad] about the object."""
    viewpoint = Viewpoints(np.array([azimuth]), np.zeros(1), np.array([range_m]))
    assert model.scores is not None
    feature = model.scores.model.predict(np.zeros(1, dtype=int), viewpoint).mean[0]
    return PlanarDetection(
        range_m=range_m,
        bearing_rad=bearing,
        covariance=np.diag([0.01, 0.0025]),
        sensor=np.zeros(2),
        feature=feature,
        feature_covariance=np.zeros((2, 2)),
    )


def history(root: Component, detections: Sequence[PlanarDetection], control: np.ndarray) -> Window:
    motion = Motion(control, np.diag([0.02, 0.02, 0.01]) ** 2)
    found = Window.of(root)
    for item in detections:
        found = found.with_keyframe(WindowStep(motion, (AssociatedDetection(item, 0, 0),)), {})
    return found


def modes_from(given: Window, robots: np.ndarray) -> list[PosteriorMode]:
    """Modes found from these poses of the robot and the object's place, best first."""
    return search_modes([SearchStart(given, robots, OBJECT[None])], SETTINGS)[0]


def modes_of(given: Window) -> list[PosteriorMode]:
    steps = [taken.motion.control for taken in given.taken]
    robots = [START]
    for control in steps:
        robots.append(se2.compose(robots[-1], control))
    return modes_from(given, np.array(robots))


def prior_evidence(given: Window, count: int = 400_000) -> tuple[float, float]:
    """Log evidence from samples of the prior, which know of no modes, and its relative standard error."""
    problem = given.problem()
    y = np.random.default_rng(1).standard_normal((count, problem.size))
    logs = problem.log_likelihood(y) + problem.log_visibility(y, soft=False)
    weights = np.exp(logs - logs.max())
    return float(logs.max() + np.log(weights.mean())), float(weights.std() / weights.mean() / np.sqrt(count))


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("visibility", [PlanarVisibility(), PlanarVisibility(3.02, 0.4)], ids=["everywhere", "limited"])
def test_evidence_of_three_keyframes_is_that_of_the_prior_s_samples(visibility: PlanarVisibility) -> None:
    model = observation(visibility)
    given = history(component(model, 1.0, 0.3), [detection(model, a) for a in (0.3, 0.4, 0.5)], np.zeros(3))
    expected, error = prior_evidence(given)
    found = float(np.logaddexp.reduce([mode.log_evidence for mode in modes_of(given)]))
    assert error < 0.02
    assert found == pytest.approx(expected, abs=4.0 * error + 0.01)


def test_coordinates_and_slopes_are_those_of_the_states() -> None:
    model = observation()
    problem = history(component(model, 1.0, 0.3), [detection(model, 0.3)] * 2, np.array([0.3, 0.1, 0.2])).problem()
    y = np.random.default_rng(0).standard_normal(problem.size)
    robots, objects = problem.states(y[None])
    np.testing.assert_allclose(problem.coordinates(robots, objects)[0], y, atol=1e-9)
    energy, gradient, _ = problem.normal_equations(y[None])
    steps = 1e-6 * np.eye(problem.size)
    numeric = (problem.energy(y + steps) - problem.energy(y - steps)) / 2e-6
    np.testing.assert_allclose(gradient[0], numeric, rtol=1e-5, atol=1e-4)
    assert problem.energy(y[None])[0] == pytest.approx(energy[0])


@pytest.mark.long
@pytest.mark.slow
def test_either_side_of_a_symmetric_object_is_a_mode_with_half_the_evidence() -> None:
    model = observation()
    given = history(component(model, 1.5, 0.4), [detection(model, 0.8)] * 2, np.zeros(3))
    modes = modes_of(given)
    assert len(modes) == 2
    sides = [mode.smoothed[robot_key(1)][1] for mode in modes]
    assert sides[0] == pytest.approx(-sides[1], abs=0.02) and abs(sides[0]) > 0.5
    evidence = np.array([mode.log_evidence for mode in modes])
    np.testing.assert_allclose(evidence - np.logaddexp.reduce(evidence), np.log(0.5), atol=0.05)
    expected, error = prior_evidence(given)
    assert np.logaddexp.reduce(evidence) == pytest.approx(expected, abs=4.0 * error + 0.01)


@pytest.mark.long
@pytest.mark.slow
def test_a_mode_answers_for_its_own_side_from_then_on() -> None:
    """One more keyframe: what both modes make of it adds up to the evidence of all."""
    model = observation()
    root = component(model, 1.5, 0.4)
    modes = modes_of(history(root, [detection(model, 0.8)] * 2, np.zeros(3)))
    assert len(modes) == 2
    total = -np.inf
    motion = Motion(np.zeros(3), np.diag([0.02, 0.02, 0.01]) ** 2)
    for mode in modes:
        assert mode.window is not None
        given = mode.window.with_keyframe(WindowStep(motion, (AssociatedDetection(detection(model, 0.9), 0, 0),)), {})
        robots = np.array([mode.smoothed[robot_key(k)] for k in (-1, 0, 1, 1)])
        found = modes_from(given, robots)
        assert np.sign(found[0].smoothed[robot_key(2)][1]) == np.sign(mode.smoothed[robot_key(1)][1])
        total = np.logaddexp(total, np.logaddexp.reduce([each.log_evidence for each in found]))
    everything = history(root, [detection(model, a) for a in (0.8, 0.8, 0.9)], np.zeros(3))
    expected, error = prior_evidence(everything)
    assert total == pytest.approx(expected, abs=4.0 * error + 0.02)


def update_of(root: Component, given: Window, mode: PosteriorMode) -> ComponentUpdate:
    """The first keyframe of a window, at one of its modes."""
    taken = given.taken[0]
    return ComponentUpdate(
        observed=taken.observed,
        objects=[OBJECT],
        robot=mode.smoothed[robot_key(0)],
        predicted=MANIFOLD.compose(root.newest_robot(), taken.motion.control),
        new_objects={},
        existence=ExistenceUpdate.starting(root.objects, []),
        window=mode.window,
        smoothed=mode.smoothed,
        corrections=mode.corrections,
    )


def test_the_component_of_a_mode_is_where_the_mode_is() -> None:
    """iSAM2 of the second mode does not slide back to the parent's side."""
    model = observation()
    root = component(model, 1.5, 0.4)
    item = detection(model, 0.8)
    given = history(root, [item], np.zeros(3))
    modes = modes_of(given)
    assert len(modes) == 2
    for mode in modes:
        robot = mode.smoothed[robot_key(0)]
        child = certain(grow([root], given.taken[0].motion, [update_of(root, given, mode)])[0])
        np.testing.assert_allclose(child.newest_robot(), robot, atol=1e-3)


@pytest.mark.long
@pytest.mark.slow
def test_moments_are_those_of_the_posterior() -> None:
    """A turned robot lost along an arc: the mean of its positions is not where its mode is."""
    model = observation()
    given = history(component(model, 2.0, 0.4), [detection(model, 0.0)], np.zeros(3))
    problem = given.problem()
    y = np.random.default_rng(2).standard_normal((1_000_000, problem.size))
    logs = problem.log_likelihood(y)
    weights = np.exp(logs - logs.max())
    expected = MANIFOLD.mean(problem.states(y)[0][:, -1], weights / weights.sum())
    modes = modes_of(given)
    shares = np.exp([mode.log_evidence for mode in modes])
    root = component(model, 2.0, 0.4)
    means = []
    for mode in modes:
        child = certain(grow([root], given.taken[0].motion, [update_of(root, given, mode)])[0])
        means.append(child.robot_and_objects([])[0][0])
    found = MANIFOLD.mean(np.array(means), shares / shares.sum())
    np.testing.assert_allclose(found, expected, atol=0.02)


@pytest.mark.slow
def test_a_component_at_which_a_history_is_anchored_stays_as_it_was() -> None:
    """Although only children use their parents' smoothers up."""
    world = make_world(5, weights={"gaussian_share": 0.999})
    pool = InProcessPool(1)
    manager = Engine.of_run(world.run, pool)
    anchors: dict[int, tuple[Component, int, np.ndarray]] = {}
    looked_at_again = 0
    for keyframe in world.keyframes:
        manager.process(keyframe)
        windows = [held.component.window for held in pool._backends[0].held.values()]
        for anchor in (history.anchor for history in windows if history is not None):
            state = anchor.newest_robot()
            looked_at_again += id(anchor) in anchors
            _, num_factors, before = anchors.setdefault(id(anchor), (anchor, anchor.smoother.kept().size(), state))
            assert anchor.smoother.kept().size() == num_factors
            assert np.array_equal(state, before)
    assert looked_at_again >= 4


def test_valleys_are_those_that_one_finds_after_the_other() -> None:
    """The best first; whoever is close to one that is kept, in its metric, is of its valley."""
    random = np.random.default_rng(5)
    owners = np.repeat(np.arange(3), [7, 1, 12])
    modes = Mode(random.normal(scale=0.4, size=(20, 2)), np.tile(2.0 * np.eye(2), (20, 1, 1)), random.normal(size=20))
    expected: list[int] = []
    for owner in range(3):
        rows = np.flatnonzero(owners == owner)
        best, kept = modes.log_evidence[rows].max(), list[int]()
        for row in rows[np.argsort(-modes.log_evidence[rows])]:
            apart = all(2.0 * ((modes.y[row] - modes.y[other]) ** 2).sum() > SAME_VALLEY**2 for other in kept)
            if modes.log_evidence[row] >= best - 2.0 and apart:
                kept.append(int(row))
        expected += kept
    assert 3 < len(expected) < 20
    assert valleys(modes, owners, 2.0).tolist() == expected


def test_valleys_end_where_a_search_went_astray() -> None:
    lost = Mode(np.array([[np.inf], [0.0], [np.inf]]), np.ones((3, 1, 1)), np.array([-np.inf, 0.0, -np.inf]))
    with np.errstate(invalid="ignore"):
        assert valleys(lost, np.array([0, 1, 1]), 14.0).tolist() == [0, 1]
