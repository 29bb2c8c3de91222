"""Which detections are outliers in their place: against the enumeration of all choices."""

from itertools import product

import numpy as np
import pytest

from semantic_slam import Configuration
from semantic_slam.inference.evidence.outlier_choices import JOINT, OutlierChoices
from semantic_slam.inference.models.noise.heavy_tail import HeavyTail
from semantic_slam.inference.states.outlier_counts import OutlierCounts

TAIL = HeavyTail(share=0.03, width=10.0)


def frame(random: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(2 n,) residuals and their covariance if none is an outlier: a pose that is shared, and objects."""
    by_pose = random.uniform(0.0, 5.0) * random.normal(size=(2 * count, 3))
    shared = by_pose @ by_pose.T + random.uniform(0.0, 4.0) * np.eye(2 * count)
    wide = np.where(random.random(count) < 0.2, TAIL.width, 1.0).repeat(2)
    return np.linalg.cholesky(shared + np.diag(wide**2)) @ random.normal(size=2 * count), shared + np.eye(2 * count)


def enumerated(residual: np.ndarray, covariance: np.ndarray, measured: np.ndarray) -> tuple[float, np.ndarray]:
    """Log density over all choices, and the probability of each detection to be an outlier."""
    choices = np.array(list(product((0, 1), repeat=len(measured))))
    logs = []
    for choice in choices:
        spread = covariance + np.diag((TAIL.added * choice[:, None] * measured).ravel())
        log_choice = np.where(choice, TAIL.log_share, TAIL.log_rest)[measured.any(axis=1)].sum()
        squared = residual @ np.linalg.solve(spread, residual)
        logs.append(log_choice - 0.5 * squared - 0.5 * np.linalg.slogdet(spread)[1])
    total = float(np.logaddexp.reduce(logs))
    return total, np.exp(np.array(logs) - total) @ choices


def compared(count: int, times: int) -> tuple[np.ndarray, np.ndarray]:
    """What log densities and probabilities differ by from those of the enumeration, at most, in many frames."""
    random, measured = np.random.default_rng(count), np.ones((count, 2), dtype=bool)
    off, changed = [], []
    for _ in range(times):
        residual, covariance = frame(random, count)
        found = OutlierChoices.of(TAIL, residual[None], covariance[None], measured[None])
        total, probability = enumerated(residual, covariance, measured)
        off.append(abs(float(found.log_density[0]) - total))
        changed.append(np.abs(found.probability[0] - probability).max())
    return np.array(off), np.array(changed)


@pytest.mark.parametrize("count", range(1, JOINT + 1))
def test_of_few_detections_all_choices_are_weighed_exactly(count):
    off, changed = compared(count, 40)
    assert max(off.max(), changed.max()) < 1e-10


def test_of_more_detections_the_weight_is_that_of_all_choices_but_for_a_hundredth_of_a_nat():
    off, changed = compared(7, 60)
    assert np.median(off) < 1e-4 and np.quantile(off, 0.95) < 0.01
    assert np.quantile(changed, 0.95) < 0.01


def test_what_a_detection_does_not_measure_widens_nothing():
    residual, covariance = np.array([0.0, 6.0]), np.diag([1.0, 2.0])
    measured = np.array([[False, True]])
    found = OutlierChoices.of(TAIL, residual[None], covariance[None], measured[None])
    total, probability = enumerated(residual, covariance, measured)
    assert found.log_density[0] == pytest.approx(total, abs=1e-12)
    assert found.probability[0] == pytest.approx(probability, abs=1e-12)
    assert found.covariance[0, 0, 0] == 1.0


def test_the_one_that_is_far_from_what_the_others_say_is_the_outlier_wherever_the_robot_is():
    by_pose = np.tile(20.0 * np.eye(2), (4, 1))
    residual = np.tile([15.0, -8.0], 4)
    residual[2:4] += [12.0, 0.0]
    covariance = by_pose @ by_pose.T + np.eye(8)
    found = OutlierChoices.of(TAIL, residual[None], covariance[None], np.ones((1, 4, 2), dtype=bool))
    assert found.outlier[0].tolist() == [False, True, False, False]
    assert found.probability[0, 1] > 0.999 and found.probability[0, [0, 2, 3]].max() < 0.01


def test_what_one_detection_costs_grows_by_the_wide_gaussian_alone():
    steps = np.array([20.0, 21.0])
    found = OutlierChoices.of(TAIL, steps[:, None], np.ones((2, 1, 1)), np.ones((2, 1, 1), dtype=bool))
    cost = float(-np.diff(found.log_density)[0])
    assert cost == pytest.approx(0.5 * (21.0**2 - 20.0**2) / TAIL.width**2, rel=1e-6)


def test_what_repeats_repeats_in_outliers_too():
    errors = Configuration.of(detection_errors={"outlier_share": 0.02, "outlier_factor": 9.0, "correlated_share": 0.9})
    tail = HeavyTail.of(errors.detection_errors, OutlierCounts())
    assert tail is not None
    assert 0.9 + 0.1 * tail.width**2 == pytest.approx(9.0)
    assert HeavyTail.of(Configuration().detection_errors, OutlierCounts()) is None


def test_the_share_is_what_was_known_before_with_what_a_history_has_had():
    errors = Configuration.of(detection_errors={"outlier_share": 0.02, "outlier_counts": 50.0}).detection_errors
    counts = OutlierCounts().with_more(np.array([1.0, 0.5, 0.0])).with_more(np.zeros(47))
    tail = HeavyTail.of(errors, counts)
    assert tail is not None and tail.share == pytest.approx((1.0 + 1.5) / 100.0)
