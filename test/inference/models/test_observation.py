"""Planar observation model: Jacobians, factors and visibility."""

from dataclasses import fields, replace

import gtsam
import numpy as np
import pytest

from semantic_slam.geometry import se2
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.planar.observation import PlanarObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.smoothing.semantic_factors import LinearisationPoints, SemanticFactor, SemanticFactorMaker
from semantic_slam.inference.states.kinds.planar_poses import PlanarPoses
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.viewpoint.model import Prediction, Viewpoints
from semantic_slam.viewpoint.parametric import ParametricModel

RANDOM = np.random.default_rng(1)
X = RANDOM.normal(size=(6, 3))
O = RANDOM.normal(loc=[2.0, 0.0, 0.0], size=(6, 3))  # noqa: E741
CLASSES = np.array([0, 1, 0, 1, 0, 1])
MODEL = PlanarObservation(ParametricModel(0.5, 15.0), PlanarVisibility())


def detection(with_range: bool) -> PlanarDetection:
    covariance = np.array([[0.1, 0.01], [0.01, 0.05]])
    return PlanarDetection(
        range_m=2.0 if with_range else float("nan"),
        bearing_rad=0.3,
        covariance=covariance,
        sensor=np.array([0.2, -0.1]),
        feature=np.array([0.6, 0.4]),
        feature_covariance=0.01 * np.eye(2),
    )


@pytest.mark.parametrize("with_range", [True, False])
@pytest.mark.parametrize("part", ["geometry", "semantics"])
@pytest.mark.parametrize("axis", range(3))
def test_jacobians_against_differences(with_range: bool, part: str, axis: int) -> None:
    z = detection(with_range)

    def evaluate(x: np.ndarray, o: np.ndarray):
        return (
            MODEL.geometry(MODEL.collect([z]), x, o)
            if part == "geometry"
            else MODEL.semantics(MODEL.collect([z]), x, o, CLASSES)
        )

    step = np.zeros(3)
    step[axis] = 1e-6
    at, exp = evaluate(X, O), se2.exp
    by_x = evaluate(se2.compose(X, exp(step)), O).residual - evaluate(se2.compose(X, exp(-step)), O).residual
    by_o = evaluate(X, se2.compose(O, exp(step))).residual - evaluate(X, se2.compose(O, exp(-step))).residual
    np.testing.assert_allclose(at.jacobian_robot[:, :, axis], by_x / 2e-6, atol=1e-7)
    np.testing.assert_allclose(at.jacobian_object[:, :, axis], by_o / 2e-6, atol=1e-7)


@pytest.mark.parametrize("with_range", [True, False])
def test_factors_are_the_likelihood(with_range: bool) -> None:
    """-log p = factor error + constant, with the same gradient that the graph sees."""
    z, x, o = detection(with_range), X[0], O[0]
    factors = [
        MODEL.geometry_factor(z, (0, 1)),
        *SemanticFactorMaker(Spaces.same(PlanarPoses()), MODEL).make(
            [[SemanticFactor(robot_key=0, object_key=1, detection=z, assigned_class=1)]],
            [LinearisationPoints.stacked(X[:1], O[:1], np.zeros((1, 0)))],
        )[0],
    ]
    values = gtsam.Values()
    values.insert(0, gtsam.Pose2(*x))
    values.insert(1, gtsam.Pose2(*o))
    geometry, semantics = (
        MODEL.geometry(MODEL.collect([z]), X[:1], O[:1]),
        MODEL.semantics(MODEL.collect([z]), X[:1], O[:1], np.array([1])),
    )
    assert factors[0].error(values) == pytest.approx(0.5 * (geometry.residual[0] ** 2).sum())
    assert factors[1].error(values) == pytest.approx(0.5 * (semantics.residual[0] ** 2).sum())
    for factor, part in zip(factors, (geometry, semantics), strict=True):
        jacobian = factor.linearize(values).jacobian()[0]
        expected = np.hstack([part.jacobian_robot[0], part.jacobian_object[0]])
        np.testing.assert_allclose(jacobian.T @ jacobian, expected.T @ expected, atol=1e-8)


def test_a_bearing_alone_leaves_the_range_free() -> None:
    """Moving the object along the ray from the camera changes nothing."""
    z = detection(False)
    robot = np.zeros((2, 3))
    ray = np.array([np.cos(0.3), np.sin(0.3)])
    objects = np.array([[*(z.sensor + 1.0 * ray), 0.0], [*(z.sensor + 7.0 * ray), 0.0]])
    assert np.abs(MODEL.geometry(MODEL.collect([z]), robot, objects).residual).max() < 1e-12


def test_the_heading_profile_is_the_density_of_turned_objects() -> None:
    """Out to half a turn where the heading is unknown, a narrow window where it is known."""
    z = detection(True)
    sigma = np.array([3.0, 0.01, 3.0, 0.01, 3.0, 0.3])
    profile, turns = MODEL.scores.heading_profile(MODEL.collect([z]), X, O, CLASSES, sigma)
    np.testing.assert_allclose(np.abs(turns).max(axis=1), [np.pi, 0.6, np.pi, 0.6, np.pi, 0.9])
    for column in range(turns.shape[1]):
        turned = O + np.stack([np.zeros(6), np.zeros(6), turns[:, column]], axis=-1)
        part = MODEL.semantics(MODEL.collect([z]), X, turned, CLASSES)
        density = part.log_normaliser - 0.5 * (part.residual**2).sum(-1)
        np.testing.assert_allclose(profile[:, column], density, atol=1e-9)


def test_what_the_best_heading_is_depends_on_no_other_row() -> None:
    seen, sigma = MODEL.collect([detection(True)]), np.array([3.0, 0.01, 3.0, 0.01, 3.0, 0.3])
    together = MODEL.best_heading(seen, X, O, CLASSES, sigma)
    for row in range(len(X)):
        alone = MODEL.best_heading(seen, *(value[row : row + 1] for value in (X, O, CLASSES, sigma)))
        np.testing.assert_array_equal([value[row] for value in together], [value[0] for value in alone])


def test_correlated_views_temper_the_whole_density() -> None:
    """N views of one kind count as one view: p^(1/N), normaliser and residual alike."""
    z = detection(True)
    once, repeated = (PlanarObservation(MODEL.scores.model, PlanarVisibility(), None, n) for n in (1.0, 4.0))

    def log_density(model: PlanarObservation) -> np.ndarray:
        part = model.semantics(MODEL.collect([z]), X, O, CLASSES)
        return part.log_normaliser - 0.5 * (part.residual**2).sum(-1)

    np.testing.assert_allclose(4.0 * log_density(repeated), log_density(once), atol=1e-9)


def test_visibility_is_hard_for_samples_and_soft_for_modes() -> None:
    visibility = PlanarVisibility(max_range_m=5.0, field_of_view_rad=2.0)
    distance, bearing = np.array([1.0, 5.5, 1.0]), np.array([0.0, 0.0, 1.2])
    assert np.array_equal(visibility.log_probability(distance, bearing, soft=False), [0.0, -np.inf, -np.inf])
    soft = visibility.log_probability(distance, bearing, soft=True)
    assert soft[0] > -1e-6 and -10.0 < soft[1] < -1.0 and -10.0 < soft[2] < -1.0


def test_robot_start_explains_the_detection() -> None:
    z = detection(True)
    start = MODEL.robot_start(MODEL.collect([z]), X, O)
    assert np.abs(MODEL.geometry(MODEL.collect([z]), start, O).residual).max() < 1e-9
    assert np.array_equal(start[:, 2], X[:, 2])


def test_an_object_first_seen_without_depth_is_guessed_with_a_guess_s_uncertainty() -> None:
    with_range, without = (MODEL.object_prior(detection(value), np.zeros(3)) for value in (True, False))
    assert (
        np.abs(MODEL.geometry(MODEL.collect([detection(True)]), np.zeros((1, 3)), with_range.mean[None]).residual).max()
        < 1e-9
    )
    assert (
        np.abs(MODEL.geometry(MODEL.collect([detection(False)]), np.zeros((1, 3)), without.mean[None]).residual).max()
        < 1e-9
    )
    assert np.sqrt(with_range.covariance[0, 0]) > 100.0
    assert np.sqrt(without.covariance[0, 0]) == pytest.approx(MODEL.new_objects.range_m)


def test_a_covariance_that_is_the_same_everywhere_counts_as_one_of_each_row_does() -> None:
    class Spelled(ParametricModel):
        def predict(self, classes: np.ndarray, viewpoints: Viewpoints) -> Prediction:
            found = super().predict(classes, viewpoints)
            return Prediction(found.mean, found.covariance.copy(), found.mean_jacobian)

    spelled = PlanarObservation(Spelled(0.5, 15.0), PlanarVisibility(), tempering=4.0)
    shared = PlanarObservation(ParametricModel(0.5, 15.0), PlanarVisibility(), tempering=4.0)
    other = replace(detection(True), feature_covariance=np.array([[0.02, 0.005], [0.005, 0.03]]))
    for seen in ([detection(True)], [detection(True), other]):
        parts = [model.semantics(model.collect(seen), X, O, CLASSES) for model in (spelled, shared)]
        for item in fields(parts[0]):
            np.testing.assert_array_equal(*(getattr(part, item.name) for part in parts))
        logs = [model.log_likelihood(model.collect(seen), X, O, CLASSES) for model in (spelled, shared)]
        np.testing.assert_array_equal(*logs)
