"""Scores of views in space: their slopes, their factor, and what the plane has of them."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest

from semantic_slam.geometry import se3
from semantic_slam.geometry.pose import pose_vector_from_planar
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.planar.observation import PlanarObservation
from semantic_slam.inference.models.planar.views import PlanarViews
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.models.spatial.bodies import BodyObservation
from semantic_slam.inference.models.spatial.detection import SpatialDetection
from semantic_slam.inference.models.spatial.views import POSES_IN_SPACE, SpatialViews
from semantic_slam.inference.models.view_scores import ViewScores
from semantic_slam.inference.smoothing.semantic_factors import LinearisationPoints, SemanticFactor, SemanticFactorMaker
from semantic_slam.viewpoint.outliers import OutlierScores
from semantic_slam.viewpoint.parametric import ParametricModel

RANDOM = np.random.default_rng(1)
X = se3.exp(RANDOM.normal(scale=[1.0, 1.0, 1.0, 0.5, 0.5, 0.5], size=(6, 6)))
O = se3.exp(RANDOM.normal(scale=[0.5, 0.5, 1.5, 1.0, 1.0, 1.0], size=(6, 6)))  # noqa: E741
CLASSES = np.array([0, 1, 0, 1, 0, 1])
CLASS_MODEL = ParametricModel(0.5, 5.0)
SEEN = SpatialDetection(
    ray=np.array([1.0, 0.0, 0.0]),
    range_m=2.0,
    covariance=0.01 * np.eye(3),
    sensor=np.array([0.2, -0.1, 0.3]),
    feature=np.array([0.6, 0.4]),
    feature_covariance=0.01 * np.eye(2),
)


def bodies(outlier_share: float = 0.0) -> BodyObservation:
    outliers = OutlierScores.of(CLASS_MODEL, outlier_share) if outlier_share else None
    return BodyObservation(scores=ViewScores(SpatialViews(), CLASS_MODEL, 2.0, outliers))


@pytest.mark.parametrize("axis", range(6))
def test_slopes_by_both_attitudes_and_places_are_differences(axis: int) -> None:
    model, step = bodies(), np.zeros(6)
    seen, step[axis] = model.collect([SEEN]), 1e-6
    at = model.semantics(seen, X, O, CLASSES)
    ends = [(se3.retract(X, sign * step), se3.retract(O, sign * step)) for sign in (1.0, -1.0)]
    by_x = np.subtract(*(model.semantics(seen, x, O, CLASSES).residual for x, _ in ends)) / 2e-6
    by_o = np.subtract(*(model.semantics(seen, X, o, CLASSES).residual for _, o in ends)) / 2e-6
    np.testing.assert_allclose(at.jacobian_robot[:, :, axis], by_x, atol=1e-7)
    np.testing.assert_allclose(at.jacobian_object[:, :, axis], by_o, atol=1e-7)


@pytest.mark.parametrize("share", [0.0, 0.1])
def test_the_likelihood_is_that_of_geometry_and_of_the_view(share: float) -> None:
    model = bodies(share)
    seen = model.collect([SEEN])
    parts = [model.geometry(seen, X, O), model.semantics(seen, X, O, CLASSES)]
    expected = sum(part.log_normaliser - 0.5 * (part.residual**2).sum(axis=1) for part in parts)
    np.testing.assert_allclose(model.log_likelihood(seen, X, O, CLASSES), expected, atol=1e-9)


def test_the_factor_is_the_likelihood() -> None:
    model = bodies()
    measured = SemanticFactor(robot_key=0, object_key=1, detection=SEEN, assigned_class=1)
    points = LinearisationPoints.stacked(X[:1], O[:1], np.zeros((1, 0)))
    ((factor,),) = SemanticFactorMaker(POSES_IN_SPACE, model).make([[measured]], [points])
    part, values = model.semantics(model.collect([SEEN]), X[:1], O[:1], np.array([1])), gtsam.Values()
    POSES_IN_SPACE.robot.insert(values, 0, X[0])
    POSES_IN_SPACE.landmark.insert(values, 1, O[0])
    assert factor.error(values) == pytest.approx(0.5 * (part.residual[0] ** 2).sum())
    jacobian = factor.linearize(values).jacobian()[0]
    expected = np.hstack([part.jacobian_robot[0], part.jacobian_object[0]])
    np.testing.assert_allclose(jacobian.T @ jacobian, expected.T @ expected, atol=1e-8)


def test_turned_about_its_own_z_a_body_shows_what_the_profile_says() -> None:
    model = bodies()
    seen = model.collect([SEEN])
    profile, turns = model.scores.heading_profile(seen, X, O, CLASSES, np.full(6, 3.0))
    for column in range(turns.shape[1]):
        about = np.zeros((6, 6))
        about[:, 2] = turns[:, column]
        part = model.semantics(seen, X, se3.retract(O, about), CLASSES)
        np.testing.assert_allclose(profile[:, column], part.log_normaliser - 0.5 * (part.residual**2).sum(1), atol=1e-9)


def test_level_views_are_those_of_the_plane() -> None:
    x, o = RANDOM.normal(size=(6, 3)), RANDOM.normal(loc=[2.0, 0.0, 0.0], size=(6, 3))
    flat = PlanarDetection(
        range_m=2.0,
        bearing_rad=0.0,
        covariance=np.eye(2),
        sensor=SEEN.sensor[:2],
        feature=SEEN.feature,
        feature_covariance=SEEN.feature_covariance,
    )
    level = replace(SEEN, sensor=np.append(SEEN.sensor[:2], 0.0))
    plane = PlanarObservation(CLASS_MODEL, PlanarVisibility(), None, 2.0)
    assert isinstance(plane.scores.geometry, PlanarViews)
    expected = plane.semantics(plane.collect([flat]), x, o, CLASSES)
    model = bodies()
    found = model.semantics(model.collect([level]), *(pose_vector_from_planar(own) for own in (x, o)), CLASSES)
    rows = [3, 4, 2]
    np.testing.assert_allclose(found.residual, expected.residual, atol=1e-12)
    np.testing.assert_allclose(found.log_normaliser, expected.log_normaliser, atol=1e-12)
    np.testing.assert_allclose(found.jacobian_robot[:, :, rows], expected.jacobian_robot, atol=1e-12)
    np.testing.assert_allclose(found.jacobian_object[:, :, rows], expected.jacobian_object, atol=1e-12)
