"""gp_correlated: evidence of correlated views, track samples, and what they make of weights, classes and poses."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from worlds.exact.solved_candidates import candidates_of
from worlds.same_beliefs import assert_same
from worlds.scenes.planar_world import World, beliefs, make_world

from semantic_slam.class_models.viewpoint_models import load_model
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.contracts.forgetful_pool import ForgetfulPool
from semantic_slam.inference.association.closed_prediction import predict
from semantic_slam.inference.building import problem_of
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.evidence.keyframe_problem import KeyframeProblem
from semantic_slam.inference.evidence.laplace import find_modes
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.planar.observation import PlanarObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.models.step import AssociatedDetection, Motion, Step
from semantic_slam.inference.semantics.correlated_views import CorrelatedViews
from semantic_slam.inference.semantics.independent_views import IndependentViews
from semantic_slam.inference.semantics.interface import SemanticEvidence, SemanticInput
from semantic_slam.inference.semantics.track_samples import StateSamples, sample_rows
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.component_update import ComponentUpdate
from semantic_slam.inference.smoothing.growth import certain, grow
from semantic_slam.inference.states.correction import Correction
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.keys import object_key, robot_key
from semantic_slam.inference.states.kinds.planar_poses import PlanarPoses
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.inference.states.tracked_objects import ExistenceUpdate
from semantic_slam.viewpoint.correlated import CorrelatedModel
from semantic_slam.viewpoint.gaussian_process import GRID, GaussianProcessModel, kernel, posterior

CORRELATED = {"semantic_model": {"kind": "gp_correlated"}}
MANIFOLD = PlanarPoses()
SPACES = Spaces.same(MANIFOLD)
GEOMETRY = PlanarObservation(None, PlanarVisibility())
SIGMA_VIEW = 0.03
LOG_PRIOR = np.log(np.full(5, 0.2))


@pytest.fixture(scope="module")
def shipped() -> GaussianProcessModel:
    model = load_model(SemanticModelConfiguration())
    assert isinstance(model, GaussianProcessModel)
    return model


@pytest.fixture(scope="module")
def correlated(shipped: GaussianProcessModel) -> CorrelatedModel:
    return CorrelatedModel(shipped, SIGMA_VIEW)


def tracks_of(correlated: CorrelatedModel, num_tracks: int, window: int = 20, average: str = "evidence"):
    return CorrelatedViews(correlated, num_tracks, window, average, seed=3)


def detection(feature: np.ndarray, spread: float = 0.02, range_m: float = 2.0) -> PlanarDetection:
    covariance = np.diag([0.1, 0.05]) ** 2
    return PlanarDetection(
        range_m=range_m,
        bearing_rad=0.0,
        covariance=covariance,
        sensor=np.zeros(2),
        feature=feature,
        feature_covariance=spread**2 * np.eye(len(feature)),
    )


def step_of(index: int, item: PlanarDetection, control: np.ndarray, sigma: float) -> Step:
    motion = Motion(control, sigma**2 * np.eye(3))
    one = np.ones(1)
    return Step(
        index=index,
        stamp_ns=index + 1,
        motion=motion,
        detections=[item],
        detection_ids=np.zeros(1, np.uint32),
        scores=one,
        names=("",),
        in_coverage=np.ones(1, dtype=bool),
    )


class OneObject:
    """A robot that sees object 0 keyframe by keyframe; the association is known."""

    def __init__(self, robot: GaussianPrior, target: GaussianPrior) -> None:
        self.component = Component.root(SPACES, GEOMETRY, robot, {0: target})

    def moment(self, step: Step) -> SemanticInput:
        predicted = predict([self.component], step.motion, [0], [{}])
        rows = Assignments(parents=np.zeros(1, dtype=int), objects=np.zeros((1, 1), dtype=int))
        stack = KeyframeProblem.of(SPACES, GEOMETRY, predicted, GEOMETRY.collect(step.detections), rows)
        mode = find_modes(stack, np.zeros((1, stack.size)))
        return SemanticInput(
            step=step,
            parents=[self.component],
            candidates=candidates_of(stack, mode),
            used=np.zeros(1, dtype=int),
            log_class_prior=LOG_PRIOR[None],
            new=[{}],
        )

    def take(self, step: Step, semantics: CorrelatedViews | IndependentViews) -> SemanticEvidence:
        moment = self.moment(step)
        weighed = semantics.weigh(moment)
        states = moment.stack.states(moment.mode.y)[0]
        update = ComponentUpdate(
            observed=[AssociatedDetection(step.detections[0], 0, -1)],
            objects=[states[1]],
            robot=states[0],
            predicted=MANIFOLD.compose(self.component.newest_robot(), step.motion.control),
            new_objects={},
            existence=ExistenceUpdate.starting(self.component.objects, []),
            views=weighed.records([0])[0],
            robot_correction=weighed.robot[0],
        )
        self.component = certain(grow([self.component], step.motion, [update])[0])
        return weighed


def known(mean: list[float], sigma: float = 1e-3, heading: float = 1e-3) -> GaussianPrior:
    return GaussianPrior(np.array(mean), np.diag([sigma, sigma, heading]) ** 2)


def dense_evidence(model: GaussianProcessModel, azimuth: np.ndarray, features: np.ndarray, spread: float) -> np.ndarray:
    """(C,) from scipy's densities; azimuths on the grid."""
    result = []
    for fit in model.fits:
        total = 0.0
        for f in range(features.shape[1]):
            sigma, length = fit.signal_sigma[f], fit.length_scale[f]
            gram = kernel(fit.azimuth_rad, fit.azimuth_rad, sigma, length) + np.diag(fit.target_variances[:, f])
            cross = kernel(azimuth, fit.azimuth_rad, sigma, length)
            cells = np.arange(len(fit.noise_covariance)) * (2 * np.pi / len(fit.noise_covariance))
            noise = np.sqrt(np.interp(azimuth, cells, fit.noise_covariance[:, f, f], period=2 * np.pi))
            covariance = kernel(azimuth, azimuth, sigma, length) - cross @ np.linalg.solve(gram, cross.T)
            shared = kernel(azimuth, azimuth, 1.0, length) * (np.outer(noise, noise) + spread**2)
            covariance += shared + SIGMA_VIEW**2 * np.eye(len(azimuth))
            total += multivariate_normal.logpdf(features[:, f], posterior(fit, f, azimuth)[0], covariance)
        result.append(0.5 * total)  # two components share each error
    return np.array(result)


def test_evidence_is_the_joint_density(shipped: GaussianProcessModel, correlated: CorrelatedModel) -> None:
    random = np.random.default_rng(0)
    azimuth = random.integers(0, GRID, (3, 6)) * (2.0 * np.pi / GRID)
    features = random.uniform(0.0, 1.0, (3, 6, 5))
    found = correlated.evidence(azimuth, features, np.full((3, 6, 5), 0.05**2))
    for row in range(3):
        expected = dense_evidence(shipped, azimuth[row], features[row], 0.05)
        np.testing.assert_allclose(found.log_likelihood[row], expected, rtol=1e-8)
        earlier = dense_evidence(shipped, azimuth[row, :-1], features[row, :-1], 0.05)
        np.testing.assert_allclose(found.newest[row], expected - earlier, rtol=1e-6, atol=1e-6)


def test_a_repeated_view_adds_next_to_nothing(correlated: CorrelatedModel, shipped: GaussianProcessModel) -> None:
    """Log-odds of the top classes after 5 and after 50 equal views; independent views multiply them by ten."""
    feature = 0.5 * (shipped.tables[1].mean[40] + shipped.tables[2].mean[40])
    odds = []
    for count in (5, 50):
        azimuth, features = np.full((1, count), np.deg2rad(40.0)), np.tile(feature, (1, count, 1))
        total = np.sort(correlated.evidence(azimuth, features, np.full((1, count, 5), 0.03**2)).log_likelihood[0])
        odds.append(total[-1] - total[-2])
    assert abs(odds[1] - odds[0]) < 1.0


def test_samples_have_the_joint_moments_of_isam2() -> None:
    robot, target = known([0, 0, 0], 0.05, 0.02), known([2, 0, 1], 0.05, 0.02)
    scene = OneObject(robot, target)
    semantics = IndependentViews(load_model(SemanticModelConfiguration()), 1.0)
    for k in range(3):
        scene.take(step_of(k, detection(np.full(5, 0.2)), np.array([0.02, 0.05, 0.01]), 0.02), semantics)
    samples = StateSamples.of(scene.component, 40_000, seed=1)
    keys = [robot_key(0), robot_key(2), object_key(0)]
    drawn = np.concatenate([samples.deviations[:, samples.rows[key]] for key in keys], axis=1)
    expected = scene.component.joint_covariance(keys)
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(np.cov(drawn.T) / np.outer(scale, scale), expected / np.outer(scale, scale), atol=0.03)


def test_sampled_continuations_follow_the_smoothed_posterior() -> None:
    """Matheron's rule moves the past along with the newest keyframe: the child's iSAM2 says the same."""
    scene = OneObject(known([0, 0, 0], 0.05, 0.02), known([2, 0, 1], 0.05, 0.02))
    semantics = IndependentViews(load_model(SemanticModelConfiguration()), 1.0)
    for k in range(3):
        scene.take(step_of(k, detection(np.full(5, 0.2)), np.array([0.02, 0.05, 0.01]), 0.05), semantics)
    last = step_of(3, detection(np.full(5, 0.2), range_m=2.1), np.array([0.02, 0.05, 0.01]), 0.05)
    row = sample_rows(scene.moment(last), 40_000, seed=1)[0]
    scene.take(last, semantics)
    states = np.stack([row.robot_at(0), row.robot_at(2), row.states[:, 0], row.states[:, 1]], axis=1)
    keys = [robot_key(0), robot_key(2), robot_key(3), object_key(0)]
    deviations = MANIFOLD.local(np.broadcast_to(scene.component.states(keys), states.shape), states).reshape(40_000, -1)
    expected = scene.component.joint_covariance(keys)
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(deviations.mean(axis=0) / scale, 0.0, atol=0.05)
    found = np.cov(deviations.T)
    np.testing.assert_allclose(found / np.outer(scale, scale), expected / np.outer(scale, scale), atol=0.05)


@pytest.mark.long
@pytest.mark.slow
def test_evidence_and_classes_are_those_of_an_integral_over_the_heading(
    correlated: CorrelatedModel, shipped: GaussianProcessModel
) -> None:
    """All is known but the object's heading: three views, and a quadrature over it."""
    sigma, target = 0.4, [2.0, 0.0, 0.3]
    scene = OneObject(known([0, 0, 0]), known(target, heading=sigma))
    features = shipped.tables[3].mean[[195, 205, 215]]
    total = 0.0
    for k, turn in enumerate(np.deg2rad([0.0, 10.0, 10.0])):
        # the robot circles the object by 10 degrees, looking at it
        control = np.array([2.0 - 2.0 * np.cos(turn), -2.0 * np.sin(turn), turn])
        step = step_of(k, detection(features[k]), control, 1e-3)
        weighed = scene.take(step, tracks_of(correlated, 20_000))
        total += weighed.log_weights[0]
    headings = target[2] + sigma * np.linspace(-6.0, 6.0, 4001)
    seen_from = np.pi + np.deg2rad([0.0, 10.0, 20.0]) - headings[:, None]
    found = correlated.evidence(seen_from, np.tile(features, (4001, 1, 1)), np.full((4001, 3, 5), 0.02**2))
    density = np.exp(-0.5 * ((headings - target[2]) / sigma) ** 2)
    density /= density.sum()
    by_class = np.log(density @ np.exp(found.log_likelihood))
    assert total == pytest.approx(np.log(np.exp(LOG_PRIOR + by_class).sum()), abs=0.1)
    views = scene.component.views[0]
    np.testing.assert_allclose(views.log_likelihood - by_class, 0.0, atol=0.15)
    weights = density * np.exp(found.log_likelihood).sum(axis=1)
    mean = (weights / weights.sum()) @ headings
    corrected = scene.component.robot_and_objects([0])
    assert corrected[0][1, 2] == pytest.approx(mean, abs=0.03)
    deviation = np.sqrt((weights / weights.sum()) @ (headings - mean) ** 2)
    assert deviation < 0.9 * sigma
    assert np.sqrt(corrected[1][1, 2, 2]) == pytest.approx(deviation, rel=0.1)


def test_a_window_counts_what_it_drops_and_keeps_its_evidence(
    correlated: CorrelatedModel, shipped: GaussianProcessModel
) -> None:
    whole, short = (OneObject(known([0, 0, 0]), known([2, 0, 0.3])) for _ in range(2))
    for k in range(6):
        step = step_of(k, detection(shipped.tables[3].mean[160]), np.zeros(3), 1e-3)
        whole.take(step, tracks_of(correlated, 200))
        short.take(step, tracks_of(correlated, 200, window=3))
    kept = short.component.views[0]
    assert (kept.dropped, len(kept.recent), whole.component.views[0].dropped) == (3, 3, 0)
    difference = kept.log_likelihood - whole.component.views[0].log_likelihood
    odds = np.abs(difference - difference[3])
    assert odds.max() < 0.1 * np.ptp(whole.component.views[0].log_likelihood)


def test_the_thesis_average_lets_geometry_stand(correlated: CorrelatedModel, shipped: GaussianProcessModel) -> None:
    """Eq. 3.20 averages normalised posteriors over equal tracks and leaves the poses alone."""
    scene = OneObject(known([0, 0, 0]), known([2, 0, 0.3], heading=0.5))
    semantics = tracks_of(correlated, 4000, average="thesis")
    step = step_of(0, detection(shipped.tables[3].mean[160]), np.zeros(3), 1e-3)
    row = sample_rows(scene.moment(step), 4000, seed=3)[0]
    weighed = scene.take(step, semantics)
    camera = row.states[:, 0, :2] - row.states[:, 1, :2]
    azimuth = np.arctan2(camera[:, 1], camera[:, 0]) - row.states[:, 1, 2]
    item = step.detections[0]
    found = correlated.evidence(azimuth[:, None], np.tile(item.feature, (4000, 1, 1)), np.full((4000, 1, 5), 0.02**2))
    likelihood = np.exp(found.log_likelihood - found.log_likelihood.max())
    expected = (likelihood / likelihood.sum(axis=1, keepdims=True)).mean(axis=0)
    posterior_of = np.exp(LOG_PRIOR + weighed.records([0])[0][0].log_likelihood)
    np.testing.assert_allclose(posterior_of / posterior_of.sum(), expected, rtol=1e-6)
    assert weighed.robot[0] is None
    assert weighed.records([0])[0][0].correction is None


@pytest.mark.parametrize("kind", ["correlated", "independent"])
def test_doubt_of_the_network_and_doubt_between_classes_differ(
    kind: str, correlated: CorrelatedModel, shipped: GaussianProcessModel
) -> None:
    """A feature halfway between two classes, seen surely; and one that the network itself is unsure of."""
    halfway = 0.5 * (shipped.tables[1].mean[180] + shipped.tables[2].mean[180])
    found = []
    for spread in (1e-3, 0.3):
        semantics = tracks_of(correlated, 200) if kind == "correlated" else IndependentViews(shipped, 1.0)
        scene = OneObject(known([0, 0, 0]), known([2, 0, 0]))
        weighed = scene.take(step_of(0, detection(halfway, spread), np.zeros(3), 1e-3), semantics)
        found.append(weighed.records([0])[0][0].mutual_information)
    assert found[0] < 0.05
    assert found[1] > 0.3


def test_views_outside_the_coverage_are_remembered(correlated: CorrelatedModel, shipped: GaussianProcessModel) -> None:
    for semantics in (tracks_of(correlated, 50), IndependentViews(shipped, 1.0)):
        scene = OneObject(known([0, 0, 0]), known([2, 0, 0]))
        inside = step_of(0, detection(shipped.tables[0].mean[180]), np.zeros(3), 1e-3)
        assert scene.take(inside, semantics).records([0])[0][0].coverage.holds(0.0, 1)
        outside = dataclasses.replace(inside, index=1, stamp_ns=2, in_coverage=np.zeros(1, dtype=bool))
        assert not scene.take(outside, semantics).records([0])[0][0].coverage.holds(0.0, 1)
        again = dataclasses.replace(inside, index=2, stamp_ns=3)
        assert list(scene.take(again, semantics).records([0])[0][0].coverage.looks.values()) == [(3, 1)]


def test_even_weights_correct_nothing() -> None:
    deviations = np.random.default_rng(0).normal(size=(30, 3))
    correction = Correction.of_samples(deviations, np.full(30, 1.0 / 30))
    np.testing.assert_allclose(correction.shift, 0.0, atol=1e-12)
    np.testing.assert_allclose(correction.covariance, np.eye(3), atol=1e-12)


def lost_world() -> World:
    return make_world(8, **CORRELATED)


@pytest.mark.slow
def test_a_lost_robot_finds_itself_and_the_classes() -> None:
    world = lost_world()
    belief = beliefs(world, 1)[-1]
    assert np.hypot(*(belief.poses[0, :2] - world.truth[-1, :2])) < 0.5
    seen = sorted({n for frame in world.associations for n in frame})
    assert (belief.class_probabilities[seen].argmax(axis=1) == 0).all()
    assert np.isfinite(belief.mutual_information[seen]).all()
    assert not belief.forgotten_views.any()


def test_views_that_leave_the_window_are_counted_in_the_belief() -> None:
    world = make_world(4, sigma_start_m=0.1, semantic_model={"kind": "gp_correlated", "window": 2})
    belief = beliefs(world, 1)[-1]
    seen = np.bincount([n for frame in world.associations for n in frame], minlength=5)
    np.testing.assert_array_equal(belief.forgotten_views, np.maximum(seen - 2, 0))


@pytest.mark.slow
def test_the_number_of_backends_changes_nothing() -> None:
    world = lost_world()
    for single, divided in zip(beliefs(world, 1), beliefs(world, 2), strict=True):
        assert_same(single, divided)


@pytest.mark.long
@pytest.mark.slow
def test_a_hypothesis_rebuilt_from_its_lineage_is_the_same() -> None:
    world = lost_world()
    pool = ForgetfulPool(2, dies_at=4)
    manager = Engine.of_run(world.run, pool)
    for steady, keyframe in zip(beliefs(world, 1), world.keyframes, strict=True):
        assert_same(steady, manager.process(keyframe))


def test_correlated_views_add_no_semantic_factor() -> None:
    """Each measurement is used once: the graph holds odometry and geometry, nothing else."""
    scene = OneObject(known([0, 0, 0]), known([2, 0, 0]))
    before = scene.component.smoother.isam.getFactorsUnsafe().size()
    problem = problem_of(lost_world().run)
    assert problem.model.num_classes == 0
    assert isinstance(problem.semantics, CorrelatedViews)
    scene.take(step_of(0, detection(np.full(5, 0.2)), np.zeros(3), 1e-3), problem.semantics)
    assert scene.component.smoother.isam.getFactorsUnsafe().size() - before == 2
