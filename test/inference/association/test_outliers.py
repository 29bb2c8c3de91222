"""Clutter, wrong identities and outliers among the scores, against sums over every choice in closed form."""

import numpy as np
import pytest
from worlds.exact.linear_gaussian import LinearDetection, LinearModel
from worlds.exact.outlier_enumeration import LinearWorld, RobustLinearModel, by_engine, by_enumeration

from semantic_slam.configuration import ClosedWorldConfiguration
from semantic_slam.inference.models.step import Motion
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.viewpoint.outliers import OutlierScores

OBJECTS = np.array([[3.0, 1.0], [3.5, -0.5]])
OFFSETS = np.array([[1.0, 0.0], [0.0, 1.0]])
SETTINGS = ClosedWorldConfiguration(clutter_per_frame=0.2, wrong_identity_share=0.05)


def geometry() -> LinearModel:
    return LinearModel(0.04 * np.eye(2), 0.05 * np.eye(2), OFFSETS, np.zeros((2, 2, 2)), 0)


def scores(slope: float, share: float = 0.1) -> RobustLinearModel:
    outliers = OutlierScores(share, np.array([0.5, 0.5]), 0.6 * np.eye(2))
    slopes = slope * np.array([np.eye(2), [[0.0, 1.0], [-1.0, 0.0]]])
    return RobustLinearModel(0.04 * np.eye(2), 0.05 * np.eye(2), OFFSETS, slopes, 2, outliers)


def make_world(model: LinearModel, seed: int = 0, names=None) -> LinearWorld:
    """Two keyframes; in the first a detection is of nothing on the map, in the second a score is wrong."""
    random = np.random.default_rng(seed)
    places = [[OBJECTS[0], OBJECTS[1] + [0.9, -0.8]], [OBJECTS[0], OBJECTS[1]]]
    truth = [np.array([0.5, 0.0]), np.array([1.0, 0.1])]
    detections = []
    for k, seen in enumerate(places):
        own = []
        for n, place in enumerate(seen):
            wrong = (k, n) == (1, 0)
            score = OFFSETS[1 - n if wrong else n] + random.normal(size=2) * 0.2
            own.append(LinearDetection(place - truth[k] + random.normal(size=2) * 0.2, score))
        detections.append(tuple(own))
    return LinearWorld(
        model=model,
        robot=GaussianPrior(np.zeros(2), 0.3 * np.eye(2)),
        objects=tuple(GaussianPrior(place, 0.05 * np.eye(2)) for place in OBJECTS),
        motions=tuple(Motion(np.array([0.5, 0.0]), 0.02 * np.eye(2)) for _ in truth),
        detections=tuple(detections),
        names=names,
        settings=SETTINGS,
    )


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("names", [None, (("0", "1"), ("1", "1"))], ids=["enumerated", "given"])
def test_clutter_and_wrong_identities_are_weighed_exactly(seed: int, names) -> None:
    world = make_world(geometry(), seed, names)
    (found, _, log_evidence, outliers), (expected, _, total) = by_engine(world), by_enumeration(world)
    assert found.keys() == expected.keys()
    assert max(abs(found[history] - expected[history]) for history in expected) < 1e-6
    assert log_evidence == pytest.approx(total, abs=1e-5)
    marginal = [sum(p for history, p in expected.items() if history[-1][i] < 0) for i in range(2)]
    np.testing.assert_allclose(outliers[-1], marginal, atol=1e-6)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize(("slope", "tolerance"), [(0.0, 1e-5), (0.15, 0.02)], ids=["scores alone", "and the viewpoint"])
@pytest.mark.parametrize("seed", range(2))
def test_outliers_among_scores_are_weighed_as_by_enumeration(seed: int, slope: float, tolerance: float) -> None:
    """Where scores tell nothing of the place the mixture is a number; else it bends a Gaussian and is sampled."""
    world = make_world(scores(slope), seed)
    (found, classes, log_evidence, _), (expected, probabilities, total) = by_engine(world), by_enumeration(world)
    assert max(abs(found.get(history, 0.0) - p) for history, p in expected.items()) < tolerance
    np.testing.assert_allclose(classes, probabilities, atol=tolerance)
    assert log_evidence == pytest.approx(total, abs=5.0 * tolerance)
