"""A learned latent space in the engine: evidence, posterior and belief against independent solutions."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from worlds.exact.solved_candidates import candidates_of
from worlds.scenes.planar_world import OBJECTS
from worlds.views.harmonic_model import HarmonicModel
from worlds.views.latent_world import MODEL, make_latent_world

from semantic_slam.geometry.pose import planar_from_pose_vector
from semantic_slam.inference.association.closed_prediction import predict
from semantic_slam.inference.backend import Backend
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.evidence.keyframe_problem import KeyframeProblem
from semantic_slam.inference.evidence.laplace import find_modes
from semantic_slam.inference.evidence.search_start import search_start
from semantic_slam.inference.models.latent.detection_features import DetectionFeatures
from semantic_slam.inference.models.latent.factor import exact_factor
from semantic_slam.inference.models.latent.observation import LatentObservation
from semantic_slam.inference.models.latent.prior import prior_of_classes
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.planar.observation import PlanarObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.models.step import Motion, Step
from semantic_slam.inference.protocol import Commit
from semantic_slam.inference.semantics.descriptors.descriptor_joint import _root
from semantic_slam.inference.semantics.descriptors.descriptor_views import DescriptorViews
from semantic_slam.inference.semantics.interface import NoSemantics, SemanticInput
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.identity import ROOT_ID
from semantic_slam.inference.states.keys import descriptor_key, object_key, robot_key
from semantic_slam.inference.states.kinds.planar_poses import PlanarPoses
from semantic_slam.inference.states.spaces import Spaces

MANIFOLD = PlanarPoses()
SPACES = Spaces.same(MANIFOLD)
GEOMETRY = PlanarObservation(None, PlanarVisibility())
TRUE = np.array([0.8, -0.5, 0.3])


def feature(model: HarmonicModel, x: np.ndarray, o: np.ndarray, seed: int) -> np.ndarray:
    mean = model.predict(SPACES.viewpoints(x[None], o[None], np.zeros(2)), TRUE[None]).mean[0]
    return mean + model.noise * np.random.default_rng(seed).normal(size=len(mean))


def moment_of(robot_sigma_rad: float, seed: int) -> SemanticInput:
    """One keyframe of one object, whose descriptor was never seen."""
    x, o = np.array([0.0, 0.0, 0.0]), np.array([2.0, 0.2, 0.7])
    observation = LatentObservation(MODEL)
    robot = GaussianPrior(x, np.diag([0.05, 0.05, robot_sigma_rad]) ** 2)
    target = GaussianPrior(o, np.diag([0.1, 0.1, 0.02]) ** 2)
    component = Component.root(SPACES, GEOMETRY, robot, {0: target}, observation)
    motion = Motion(np.zeros(3), np.diag([1e-4, 1e-4, 1e-6]))
    truth = np.array([0.02, -0.05, 0.7 * robot_sigma_rad])
    seen = o[:2] - truth[:2]
    bearing = float(np.arctan2(seen[1], seen[0]) - truth[2])
    covariance = np.diag([0.1, 0.05]) ** 2
    none = np.zeros((MODEL.num_features, MODEL.num_features))
    value = feature(MODEL, truth, o, seed)
    detection = PlanarDetection(
        range_m=float(np.hypot(*seen)),
        bearing_rad=bearing,
        covariance=covariance,
        sensor=np.zeros(2),
        feature=value,
        feature_covariance=none,
    )
    step = Step(
        index=0,
        stamp_ns=1,
        motion=motion,
        detections=[detection],
        detection_ids=np.zeros(1, np.uint32),
        scores=np.ones(1),
        names=("",),
        in_coverage=np.ones(1, dtype=bool),
    )
    predicted = predict([component], motion, [0], [{}])
    rows = Assignments(parents=np.zeros(1, int), objects=np.zeros((1, 1), int))
    stack = KeyframeProblem.of(SPACES, GEOMETRY, predicted, GEOMETRY.collect([detection]), rows)
    mode = find_modes(stack, search_start(stack))
    return SemanticInput(
        step=step,
        parents=[component],
        candidates=candidates_of(stack, mode),
        used=np.array([0]),
        log_class_prior=np.log(np.full((1, 2), 0.5)),
        new=[{}],
    )


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("robot_sigma_rad", [0.05, 0.2])
def test_evidence_against_a_numerical_integral(robot_sigma_rad: float, seed: int) -> None:
    """Given the direction, e is linear: N(f; mu_0, S + J P J^T), averaged over the geometric posterior."""
    moment = moment_of(robot_sigma_rad, seed)
    found = DescriptorViews(LatentObservation(MODEL)).weigh(moment).log_weights[0]
    random, stack = np.random.default_rng(seed), moment.stack
    count = 20_000
    root = np.linalg.cholesky(np.linalg.inv(moment.mode.hessian[0]))
    y = moment.mode.y + random.normal(size=(count, stack.size)) @ root.T
    states = stack.select(np.zeros(count, dtype=int)).states(y)
    views = SPACES.viewpoints(states[:, 0], states[:, 1], np.zeros(2))
    part = MODEL.predict(views, np.zeros((count, 3)))
    covariance = np.eye(MODEL.num_features) * MODEL.noise**2
    covariance = covariance + part.by_descriptor @ np.swapaxes(part.by_descriptor, 1, 2)
    residual = moment.step.detections[0].feature - part.mean
    squared = (residual * np.linalg.solve(covariance, residual[..., None])[..., 0]).sum(-1)
    logs = -0.5 * (squared + np.linalg.slogdet(2 * np.pi * covariance)[1])
    exact = np.logaddexp.reduce(logs) - np.log(count)
    assert found == pytest.approx(exact, abs=0.35)


def run_world(num_keyframes: int, **settings):
    world = make_latent_world(num_keyframes, **settings)
    manager = Engine.of_run(world.run, (pool := _Pool(world.problem)), world.problem)
    beliefs = [manager.process(frame) for frame in world.keyframes]
    return world, manager, pool.backend, beliefs


class _Pool:
    """One backend, to be looked into."""

    backend_ids = (0,)

    def __init__(self, problem) -> None:
        self.backend = Backend(0, problem)

    def start(self, run) -> None:
        self.backend.start(run)

    def begin(self, keyframe) -> None:
        pass

    def expand(self, keyframe):
        return [self.backend.expand(keyframe)]

    def commit(self, commit):
        return [answer for answer in (self.backend.commit(commit),) if answer is not None]


@pytest.fixture(scope="module")
def drive():
    return run_world(10)


def test_a_lost_robot_finds_the_association_and_the_descriptors(drive) -> None:
    world, _, _, beliefs = drive
    final = beliefs[-1]
    best = int(np.argmax(final.log_weights))
    assert tuple(final.associations[best]) == world.associations[-1]
    assert np.exp(final.log_weights[best]) > 0.99
    error = planar_from_pose_vector(final.poses[best])[:2] - world.truth[-1][:2]
    assert np.linalg.norm(error) < 0.25
    seen = sorted({n for association in world.associations for n in association})
    deviation = (final.descriptors - world.descriptors)[seen] / np.sqrt(final.descriptor_covariances[seen])
    assert (deviation**2).mean() < 3.0
    assert final.descriptors.shape == final.descriptor_covariances.shape == (len(OBJECTS), MODEL.num_dimensions)


def test_unseen_objects_keep_their_prior(drive) -> None:
    _, _, _, beliefs = drive
    first = beliefs[0]
    seen = {first.object_ids[place] for place in first.associations[0]}
    rows = [row for row, n in enumerate(first.object_ids) if n not in seen]
    if len(first.log_weights) == 1:
        np.testing.assert_allclose(first.descriptors[rows], 0.0)
        np.testing.assert_allclose(first.descriptor_covariances[rows], 1.0)


def test_classes_follow_from_the_descriptors(drive) -> None:
    """Grounded: class 'second' lies at positive first components."""
    world, _, _, beliefs = drive
    seen = {n for association in world.associations for n in association}
    clear = [n for n in sorted(seen) if abs(world.descriptors[n, 0]) > 0.6]
    expected = (world.descriptors[clear, 0] > 0.0).astype(int)
    assert list(beliefs[-1].class_probabilities[clear].argmax(axis=1)) == list(expected)
    np.testing.assert_allclose(beliefs[-1].class_probabilities.sum(axis=1), 1.0)


def test_incremental_is_the_batch_optimum(drive) -> None:
    """All factors at once, the semantic ones exact, by Levenberg-Marquardt from what iSAM2 has."""
    _, manager, backend, _ = drive
    number = max(manager.live, key=lambda n: manager.live[n].log_weight)
    smoother = backend.held[number].component.smoother
    estimate = smoother.isam.calculateEstimate()
    graph = gtsam.NonlinearFactorGraph(smoother.kept())
    for measurements in smoother.factor_table.measurements:
        graph.add(exact_factor(backend.problem.latent, measurements.detection, measurements.keys))
    batch = gtsam.LevenbergMarquardtOptimizer(graph, estimate).optimize()
    poses = [key for key in estimate.keys() if key >= object_key(0)]  # noqa: SIM118
    for key in poses:
        assert np.abs(MANIFOLD.local(MANIFOLD.state(estimate, key), MANIFOLD.state(batch, key))).max() < 0.02
    for object_id in backend.held[number].component.views:
        key = descriptor_key(object_id)
        np.testing.assert_allclose(estimate.atVector(key), batch.atVector(key), atol=0.05)


def test_every_view_has_one_factor_and_exact_ones_become_linear(drive) -> None:
    world, manager, backend, _ = drive
    number = max(manager.live, key=lambda n: manager.live[n].log_weight)
    smoother = backend.held[number].component.smoother
    factors = gtsam.NonlinearFactorGraph(smoother.isam.getFactorsUnsafe())
    assert len(smoother.factor_table) == sum(len(seen) for seen in world.associations)
    assert len(set(smoother.factor_table.indices)) == len(smoother.factor_table)
    kinds = [type(factors.at(index)) for index in smoother.factor_table.indices]
    assert set(kinds) == {gtsam.LinearContainerFactor}
    poses = len(world.keyframes) + 1
    in_graph = sum(factors.exists(i) for i in range(factors.size()))
    objects = len(OBJECTS)
    descriptors = smoother.num_descriptors
    priors = 2 * objects  # of position and heading each
    assert in_graph == poses + priors + descriptors + 2 * len(smoother.factor_table)


@pytest.mark.slow
def test_a_component_is_rebuilt_from_its_lineage(drive) -> None:
    world, manager, backend, _ = drive
    number = max(manager.live, key=lambda n: manager.live[n].log_weight)
    live = manager.live[number]
    other = Backend(1, world.problem)
    other.start(world.run)
    for frame in world.keyframes:
        other.expand(frame)
        other.committed = frame.index
    commit = Commit(
        run_id=world.run.run_id,
        keyframe=len(world.keyframes) - 1,
        ids=np.array([number], np.uint64),
        parent_ids=np.array([live.parent_id], np.uint64),
        steps=live.lineage[-1:],
        log_weights=np.zeros(1),
        owners=np.ones(1, np.uint32),
        lineages=(live.lineage[:-1],),
    )
    answer = other.commit(commit)
    assert answer is not None and list(answer.ids) == [number]
    keys = [robot_key(len(world.keyframes) - 1), object_key(0)]
    own, rebuilt = (each.held[number].component for each in (backend, other))
    np.testing.assert_allclose(own.states(keys), rebuilt.states(keys), atol=1e-3)
    assert ROOT_ID not in other.held


def test_features_tell_hypotheses_apart() -> None:
    """The same drive without features stays ambiguous longer than with them."""
    world, _, _, beliefs = run_world(3)
    blind = replace(world.problem, semantics=NoSemantics(), latent=None)
    manager = Engine.of_run(world.run, _Pool(blind), blind)
    plain = [manager.process(frame) for frame in world.keyframes]
    assert beliefs[0].association_entropy < plain[0].association_entropy


@pytest.mark.parametrize("method", ["importance", "laplace"])
@pytest.mark.parametrize("seed", [1, 3])
def test_a_robot_that_jumps_takes_its_descriptors_along(method: str, seed: int) -> None:
    """Lost by metres it is found with the first keyframe, and stays on the true association."""
    world, _, _, beliefs = run_world(3, seed=seed, weights={"method": method})
    for belief, seen in zip(beliefs, world.associations, strict=True):
        right = [tuple(row) == seen for row in belief.associations]
        assert np.exp(belief.log_weights)[right].sum() > 0.95


def test_a_map_that_knows_the_class_narrows_the_descriptor() -> None:
    """P(e | second) is Gaussian about +1 in the first component; times N(0, 1) that is N(0.8, 0.2)."""
    told = prior_of_classes(MODEL, np.array([0.0, 1.0]))
    np.testing.assert_allclose(told.mean[0], [0.8, 0.0, 0.0], atol=0.05)
    np.testing.assert_allclose(told.sigma[0] ** 2, [0.2, 1.0, 1.0], atol=0.08)
    untold = prior_of_classes(MODEL, np.array([0.5, 0.5]))
    np.testing.assert_allclose(untold.sigma, MODEL.prior.sigma)


def test_measured_elevation_enters() -> None:
    """mu has 0.3 el in every component."""
    none = np.zeros((MODEL.num_features, MODEL.num_features))
    level = PlanarDetection(
        range_m=2.0,
        bearing_rad=0.0,
        covariance=0.01 * np.eye(2),
        sensor=np.zeros(2),
        feature=np.zeros(MODEL.num_features),
        feature_covariance=none,
    )
    seen = [DetectionFeatures.of([replace(level, elevation_rad=value)]) for value in (0.0, 0.5)]
    states = np.zeros((1, 3)), np.array([[2.0, 0.0, 0.3]]), TRUE[None]
    low, high = (LatentObservation(MODEL).linearise(own, *states).residual[0] for own in seen)
    np.testing.assert_allclose((high - low) * MODEL.noise, 0.15)


def test_rounded_covariances_still_have_roots() -> None:
    """An eigenvalue of -1e-3 becomes a small positive one, the others stay; exact ones are left alone."""
    vectors = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    covariance = np.stack([(vectors * [1.0, 0.5, last]) @ vectors.T for last in (-1e-3, 0.2)])
    scale = np.einsum("bii->bi", np.abs(covariance))
    roots = _root(covariance, scale)
    rebuilt = roots @ np.swapaxes(roots, 1, 2)
    assert np.linalg.eigvalsh(rebuilt).min() > 0.0
    np.testing.assert_allclose(rebuilt, covariance, atol=5e-3)
    np.testing.assert_allclose(_root(covariance[1:], scale[1:]) @ _root(covariance[1:], scale[1:])[0].T, covariance[1:])
