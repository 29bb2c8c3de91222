"""Innovations of a keyframe, jointly: against the least energy, and against a Kalman filter written out."""

import numpy as np
import pytest

from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.evidence.innovation import innovation_nees
from semantic_slam.inference.evidence.keyframe_problem import KeyframeProblem, PredictedBelief
from semantic_slam.inference.evidence.laplace import find_modes
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.planar.observation import POSES_IN_PLANE, PlanarObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility

NOISE = np.diag([0.1, 0.05]) ** 2
MODEL = PlanarObservation(None, PlanarVisibility())
ROBOT = np.array([0.0, 0.0, 0.0])
OBJECTS = np.array([[4.0, 1.0, 0.0], [3.0, -2.0, 0.0], [5.0, 2.5, 0.0]])


def detection(range_m: float, bearing_rad: float) -> PlanarDetection:
    return PlanarDetection(
        range_m=range_m,
        bearing_rad=bearing_rad,
        covariance=NOISE,
        sensor=np.zeros(2),
        feature=np.zeros(0),
        feature_covariance=np.zeros((0, 0)),
    )


def problem_of(detections: list[PlanarDetection], rows: list[list[int]], sigma: float) -> KeyframeProblem:
    """Candidates ``rows`` of one parent, robot and objects being known to ``sigma``, and correlated."""
    size = 3 * (1 + len(OBJECTS))
    root = np.random.default_rng(3).normal(size=(size, size)) / np.sqrt(size) + np.eye(size)
    predicted = PredictedBelief(POSES_IN_PLANE.layout, np.array([[ROBOT, *OBJECTS]]), sigma**2 * (root @ root.T)[None])
    assignments = Assignments(parents=np.zeros(len(rows), dtype=int), objects=np.array(rows, dtype=int))
    return KeyframeProblem.of(POSES_IN_PLANE, MODEL, predicted, MODEL.collect(detections), assignments)


def measured(errors: np.ndarray) -> list[PlanarDetection]:
    ranges, bearings = np.hypot(*OBJECTS[:, :2].T), np.arctan2(OBJECTS[:, 1], OBJECTS[:, 0])
    return [detection(r + a, b + c) for r, b, (a, c) in zip(ranges, bearings, errors, strict=True)]


ERRORS = np.array([[0.4, 0.1], [-0.2, 0.12], [0.1, -0.2]])


@pytest.mark.parametrize("sigma", [0.1, 0.5])
def test_innovation_nees_at_a_mode_is_twice_the_least_energy(sigma: float) -> None:
    problem = problem_of(measured(ERRORS), [[0, 1, 2], [1, 0, 2]], sigma)
    mode = find_modes(problem, np.zeros((2, problem.size)))
    peaks = sum(detection.log_normaliser for detection in measured(ERRORS))
    expected = 2.0 * (problem.energy(mode.y) + peaks) / 6.0
    np.testing.assert_allclose(innovation_nees(problem, mode.y, 3), expected, rtol=1e-4)


def test_innovation_nees_of_a_linear_problem_is_the_kalman_filters() -> None:
    problem = problem_of(measured(ERRORS), [[0, 1, 2]], 0.01)
    start = np.zeros((1, problem.size))
    residual, jacobian = (part[0] for part in problem.geometry_rows(start))
    jacobian = jacobian.reshape(6, -1)
    covariance = jacobian @ jacobian.T + np.eye(6)
    expected = residual.ravel() @ np.linalg.inv(covariance) @ residual.ravel() / 6.0
    assert innovation_nees(problem, start, 3)[0] == pytest.approx(expected, rel=1e-12)
    alone = sum(
        innovation_nees(problem_of([d], [[n]], 0.01), np.zeros((1, 6)), 3)[0]
        for n, d in zip(range(3), measured(ERRORS), strict=True)
    )
    assert abs(alone / 3.0 - expected) > 1e-4  # what the detections share counts once


def test_clutter_and_new_objects_count_nothing() -> None:
    problem = problem_of(measured(ERRORS), [[0, -1, -1], [0, 1, 2], [-1, -1, 2]], 0.1)
    y = np.zeros((3, problem.size))
    alone = innovation_nees(problem_of(measured(ERRORS)[:1], [[0]], 0.1), np.zeros((1, 6)), 2)[0]
    found = innovation_nees(problem, y, 2)
    assert found[0] == pytest.approx(alone, rel=1e-12) and np.isfinite(found[1]) and np.isnan(found[2])


def test_a_bearing_alone_has_one_degree_of_freedom() -> None:
    seen = [
        PlanarDetection(
            range_m=np.nan,
            bearing_rad=np.arctan2(1.0, 4.0) + 0.1,
            covariance=NOISE,
            sensor=np.zeros(2),
            feature=np.zeros(0),
            feature_covariance=np.zeros((0, 0)),
        )
    ]
    problem = problem_of(seen, [[0]], 1e-6)
    assert innovation_nees(problem, np.zeros((1, 6)), 3)[0] == pytest.approx((0.1 / 0.05) ** 2, rel=1e-6)


def test_innovations_of_no_detections_are_not_known() -> None:
    problem = problem_of([], [[]], 0.1)
    assert np.isnan(innovation_nees(problem, np.zeros((1, 3)), 3)).all()
