"""The factor between a robot, an object and its descriptor."""

import gtsam
import numpy as np
import pytest
from worlds.views.harmonic_model import HarmonicModel

from semantic_slam.geometry import se2
from semantic_slam.inference.models.latent.detection_features import DetectionFeatures
from semantic_slam.inference.models.latent.factor import exact_factor
from semantic_slam.inference.models.latent.observation import LatentObservation
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.planar.observation import PlanarObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.smoothing.semantic_factors import LinearisationPoints, SemanticFactor, SemanticFactorMaker
from semantic_slam.inference.states.kinds.planar_poses import PlanarPoses
from semantic_slam.inference.states.spaces import Spaces

RANDOM = np.random.default_rng(2)
MODEL = HarmonicModel()
LATENT = LatentObservation(MODEL, tempering=2.0)
COUNT = 5
X = RANDOM.normal(size=(COUNT, 3))
O = RANDOM.normal(loc=[2.0, 0.0, 0.0], size=(COUNT, 3))  # noqa: E741
E = RANDOM.normal(size=(COUNT, MODEL.num_dimensions))
KEYS = (gtsam.symbol("x", 3), gtsam.symbol("o", 1), gtsam.symbol("e", 1))


def detection(number: int) -> PlanarDetection:
    random = np.random.default_rng(number)
    feature = random.normal(size=MODEL.num_features)
    spread = 0.01 * np.diag(1.0 + random.uniform(size=MODEL.num_features))
    return PlanarDetection(
        range_m=2.0,
        bearing_rad=0.3,
        covariance=0.01 * np.eye(2),
        sensor=np.array([0.2, -0.1]),
        feature=feature,
        feature_covariance=spread,
        elevation_rad=0.2,
    )


DETECTIONS = [detection(number) for number in range(COUNT)]
SEEN = DetectionFeatures.of(DETECTIONS)


def values(x: np.ndarray, o: np.ndarray, e: np.ndarray, keys: tuple[int, int, int]) -> gtsam.Values:
    found = gtsam.Values()
    found.insert(keys[0], gtsam.Pose2(*x))
    found.insert(keys[1], gtsam.Pose2(*o))
    found.insert(keys[2], e)
    return found


@pytest.mark.parametrize("axis", range(3))
def test_jacobians_by_poses_against_differences(axis: int) -> None:
    step = np.zeros(3)
    step[axis] = 1e-6
    at = LATENT.linearise(SEEN, X, O, E)
    ahead, back = (LATENT.linearise(SEEN, se2.compose(X, se2.exp(s)), O, E).residual for s in (step, -step))
    np.testing.assert_allclose(at.by_robot[:, :, axis], (ahead - back) / 2e-6, atol=1e-6)
    ahead, back = (LATENT.linearise(SEEN, X, se2.compose(O, se2.exp(s)), E).residual for s in (step, -step))
    np.testing.assert_allclose(at.by_object[:, :, axis], (ahead - back) / 2e-6, atol=1e-6)


@pytest.mark.parametrize("axis", range(MODEL.num_dimensions))
def test_jacobian_by_the_descriptor_against_differences(axis: int) -> None:
    step = np.zeros(MODEL.num_dimensions)
    step[axis] = 1e-6
    ahead, back = (LATENT.linearise(SEEN, X, O, E + s).residual for s in (step, -step))
    at = LATENT.linearise(SEEN, X, O, E).by_descriptor
    np.testing.assert_allclose(at[:, :, axis], (ahead - back) / 2e-6, atol=1e-6)


def test_moving_robot_and_object_together_changes_nothing() -> None:
    """The feature depends on the relative pose: J_x Ad + J_o = 0 for a common motion of the map."""
    move = np.array([0.7, -0.3, 1.1])
    moved = LATENT.linearise(SEEN, se2.compose(move, X), se2.compose(move, O), E)
    np.testing.assert_allclose(moved.residual, LATENT.linearise(SEEN, X, O, E).residual, atol=1e-9)


def test_range_is_not_observed() -> None:
    """A step of the camera towards the object leaves the feature as it is."""
    towards = O[:, :2] - (X[:, :2] + np.stack([_turned(x[2], DETECTIONS[0].sensor) for x in X]))
    closer = X.copy()
    closer[:, :2] += 0.3 * towards
    np.testing.assert_allclose(
        LATENT.linearise(SEEN, closer, O, E).residual, LATENT.linearise(SEEN, X, O, E).residual, atol=1e-9
    )


def _turned(angle: float, point: np.ndarray) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ point


def test_the_density_is_tempered() -> None:
    """N(f; mu, S)^(1/2), S being the model's variance and that of the dropout passes."""
    prediction_variance = MODEL.noise**2 + SEEN.variance
    alone = LatentObservation(MODEL).linearise(SEEN, X, O, E)
    np.testing.assert_allclose(LATENT.linearise(SEEN, X, O, E).log_density(), 0.5 * alone.log_density())
    residual = alone.residual * np.sqrt(prediction_variance)
    expected = -0.5 * (residual**2 / prediction_variance + np.log(2 * np.pi * prediction_variance)).sum(-1)
    np.testing.assert_allclose(alone.log_density(), expected)


def test_both_factors_linearise_alike() -> None:
    symbols = [tuple(gtsam.symbol(letter, row) for letter in "xoe") for row in range(COUNT)]
    measurements = [
        SemanticFactor(robot_key=x, object_key=o, detection=detection, assigned_class=-1, descriptor_key=e)
        for (x, o, e), detection in zip(symbols, DETECTIONS, strict=True)
    ]
    factors = SemanticFactorMaker(Spaces.same(PlanarPoses()), PlanarObservation(None, PlanarVisibility()), LATENT)
    linear = factors.make([measurements], [LinearisationPoints.stacked(X, O, E)])[0]
    for row in range(COUNT):
        at = values(X[row], O[row], E[row], symbols[row])
        exact = exact_factor(LATENT, DETECTIONS[row], symbols[row])
        assert exact.error(at) == pytest.approx(linear[row].error(at))
        jacobian, right = exact.linearize(at).jacobian()
        other, other_right = linear[row].linearize(at).jacobian()
        np.testing.assert_allclose(jacobian, other, atol=1e-12)
        np.testing.assert_allclose(right, other_right, atol=1e-12)


def test_levenberg_marquardt_and_isam2_agree() -> None:
    """A robot that drives around an object learns its descriptor; batch and incremental are the same optimum."""
    graph, start, steps = _orbit()
    batch = gtsam.LevenbergMarquardtOptimizer(graph, start).optimize()
    parameters = gtsam.ISAM2Params()
    parameters.relinearizeSkip = 1
    parameters.setRelinearizeThreshold(1e-4)
    isam = gtsam.ISAM2(parameters)
    for new, initial in steps:
        isam.update(new, initial)
    for _ in range(5):
        isam.update()
    estimate = gtsam.ISAM2(isam).calculateEstimate()
    np.testing.assert_allclose(estimate.atVector(KEYS[2]), batch.atVector(KEYS[2]), atol=1e-4)
    assert estimate.atPose2(KEYS[1]).equals(batch.atPose2(KEYS[1]), 1e-4)
    np.testing.assert_allclose(batch.atVector(KEYS[2]), TRUE_DESCRIPTOR, atol=0.25)


TRUE_DESCRIPTOR = np.array([0.8, -0.5, 0.3])


def _orbit():
    random = np.random.default_rng(0)
    target, latent = np.array([0.0, 0.0, 0.4]), LatentObservation(MODEL)
    whole, start, steps = gtsam.NonlinearFactorGraph(), gtsam.Values(), []
    poses = [np.array([2 * np.cos(a), 2 * np.sin(a), a + np.pi]) for a in np.arange(0.0, 3.0, 0.3)]
    for k, x in enumerate(poses):
        graph, initial = gtsam.NonlinearFactorGraph(), gtsam.Values()
        key = gtsam.symbol("x", k)
        if k == 0:
            graph.add(gtsam.PriorFactorPose2(key, gtsam.Pose2(*x), gtsam.noiseModel.Isotropic.Sigma(3, 0.05)))
            wide = gtsam.noiseModel.Diagonal.Sigmas(np.array([1.0, 1.0, 0.5]))
            graph.add(gtsam.PriorFactorPose2(KEYS[1], gtsam.Pose2(*target), wide))
            graph.add(gtsam.PriorFactorVector(KEYS[2], np.zeros(3), gtsam.noiseModel.Isotropic.Sigma(3, 1.0)))
            initial.insert(KEYS[1], gtsam.Pose2(0.1, -0.1, 0.5))
            initial.insert(KEYS[2], np.zeros(3))
        else:
            control = gtsam.Pose2(*se2.between(poses[k - 1], x))
            noise = gtsam.noiseModel.Isotropic.Sigma(3, 0.05)
            graph.add(gtsam.BetweenFactorPose2(gtsam.symbol("x", k - 1), key, control, noise))
        initial.insert(key, gtsam.Pose2(*se2.compose(x, 0.02 * random.normal(size=3))))
        bearing = gtsam.BearingRangeFactorPose2(
            key, KEYS[1], gtsam.Rot2.fromAngle(0.0), 2.0, gtsam.noiseModel.Isotropic.Sigma(2, 0.05)
        )
        graph.add(bearing)
        blank = PlanarDetection(
            range_m=2.0,
            bearing_rad=0.0,
            covariance=0.01 * np.eye(2),
            sensor=np.zeros(2),
            feature=np.zeros(8),
            feature_covariance=np.zeros((8, 8)),
        )
        seen = DetectionFeatures.of([blank])
        mean = latent.linearise(seen, x[None], target[None], TRUE_DESCRIPTOR[None]).residual[0] * MODEL.noise
        feature = mean + MODEL.noise * random.normal(size=8)
        view = PlanarDetection(
            range_m=2.0,
            bearing_rad=0.0,
            covariance=0.01 * np.eye(2),
            sensor=np.zeros(2),
            feature=feature,
            feature_covariance=np.zeros((8, 8)),
        )
        graph.add(exact_factor(latent, view, (key, KEYS[1], KEYS[2])))
        for n in range(graph.size()):
            whole.add(graph.at(n))
        start.insert(initial)
        steps.append((graph, initial))
    return whole, start, steps
