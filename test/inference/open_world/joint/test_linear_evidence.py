"""Joint assignments weighed at one linearisation, against the Kalman update of each by itself."""

from functools import cached_property

import numpy as np
import pytest
from worlds.exact.linear_gaussian import LinearDetection, LinearModel

from semantic_slam.inference.association.gating import pair_densities
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.evidence.keyframe_problem import PredictedBelief
from semantic_slam.inference.open_world.births import Birth
from semantic_slam.inference.open_world.joint.linear_evidence import LinearisedEvidence
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.kinds.planar_positions import PlanarPositions
from semantic_slam.inference.states.spaces import Spaces

SPACES = Spaces.same(PlanarPositions())
VARIANCE, OBJECTS, DETECTIONS = 0.04, 3, 4
COLUMNS = np.array([[0, 1, 2, 6], [2, 4, 0, -1], [3, 4, 5, 6], [1, 0, -1, 6], [-1, -1, -1, -1], [2, 1, 5, 0]])
"""Joint assignments (K, D): an object, 3 + i where detection i starts one, or -1."""


class Frame:
    """Four detections from a robot, three objects in its map; any of them may start an object."""

    def __init__(self, seed: int) -> None:
        random = np.random.default_rng(seed)
        root = random.normal(size=(8, 8))
        self.mean, self.covariance = random.normal(size=(1 + OBJECTS, 2)), root @ root.T
        self.seen = random.normal(size=(DETECTIONS, 2))
        self.births = [self._birth(random, number) for number in range(DETECTIONS)]

    @staticmethod
    def _birth(random: np.random.Generator, number: int) -> Birth:
        gain, root = random.normal(size=(2, 2, 2))
        return Birth(
            prior=GaussianPrior(random.normal(size=2), np.eye(2)),
            gain=gain,
            spread=25.0 * root @ root.T,
            noise=root @ root.T,
            by_error=np.zeros((2, 2)),
            log_area=0.0,
            log_stand_in=-0.3 * (1 + number),
        )

    @cached_property
    def linear(self) -> LinearisedEvidence:
        model = LinearModel(VARIANCE * np.eye(2), np.eye(2), np.zeros((0, 2)), np.zeros((0, 2, 2)), 0)
        detections = [LinearDetection(place, np.zeros(2)) for place in self.seen]
        predicted = PredictedBelief(SPACES.layout, self.mean[None], self.covariance[None])
        pairs = pair_densities(SPACES, model, detections, predicted)
        return LinearisedEvidence(SPACES, self.mean, self.covariance, pairs, self.births, np.zeros(DETECTIONS))

    def weighed(self, columns: np.ndarray) -> Assignments:
        rows = Assignments(parents=np.zeros(len(columns), dtype=int), objects=columns)
        return self.linear.evaluate(rows, columns)

    def updated(self, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """(1 + M, 2) mean and covariance of robot and objects given detections by (D,) columns, and log evidence."""
        mean, covariance, log_evidence = self.mean.ravel(), self.covariance, 0.0
        for number, column in enumerate(columns):
            if 0 <= column < OBJECTS:
                slopes = np.zeros((2, len(mean)))
                slopes[:, :2], slopes[:, 2 + 2 * column : 4 + 2 * column] = -np.eye(2), np.eye(2)
                spread = slopes @ covariance @ slopes.T + VARIANCE * np.eye(2)
                off, gain = self.seen[number] - slopes @ mean, covariance @ slopes.T @ np.linalg.inv(spread)
                log_evidence -= 0.5 * (off @ np.linalg.solve(spread, off) + np.linalg.slogdet(2.0 * np.pi * spread)[1])
                mean, covariance = mean + gain @ off, covariance - gain @ spread @ gain.T
        return mean.reshape(-1, 2), covariance, log_evidence


@pytest.mark.parametrize("seed", range(3))
def test_states_and_evidence_are_those_of_kalman_updates_one_by_one(seed: int) -> None:
    frame = Frame(seed)
    found = frame.weighed(COLUMNS)
    for row, columns in enumerate(COLUMNS):
        mean, covariance, log_evidence = frame.updated(columns)
        robot = covariance[:2, :2]
        np.testing.assert_allclose(found.column("robot")[row], mean[0], atol=1e-9)
        np.testing.assert_allclose(found.column("robot_covariance")[row], robot, atol=1e-9)
        states, covariances, crosses = (
            found.column(name)[row] for name in ("object_states", "object_covariances", "object_crosses")
        )
        for number, column in enumerate(columns):
            if column < 0:
                assert np.isnan(states[number]).all() and np.isnan(covariances[number]).all()
            elif column < OBJECTS:
                own = slice(2 + 2 * column, 4 + 2 * column)
                np.testing.assert_allclose(states[number], mean[1 + column], atol=1e-9)
                np.testing.assert_allclose(covariances[number], covariance[own, own], atol=1e-9)
                np.testing.assert_allclose(crosses[number], covariance[:2, own], atol=1e-9)
            else:
                born = frame.births[number]
                log_evidence += born.log_stand_in
                shift = mean[0] - frame.mean[0]
                np.testing.assert_allclose(states[number], born.prior.mean + born.gain @ shift, atol=1e-9)
                spread = born.gain @ robot @ born.gain.T + born.noise
                np.testing.assert_allclose(covariances[number], spread, atol=1e-9)
                np.testing.assert_allclose(crosses[number], robot @ born.gain.T, atol=1e-9)
        assert found.column("log_evidence")[row] == pytest.approx(log_evidence, abs=1e-9)


def test_an_assignment_is_weighed_alike_whatever_others_there_are() -> None:
    frame = Frame(0)
    together = frame.weighed(COLUMNS)
    for row in range(len(COLUMNS)):
        alone = frame.weighed(COLUMNS[row : row + 1])
        for name in ("log_evidence", "robot", "object_states", "object_covariances", "object_crosses"):
            np.testing.assert_array_equal(alone.column(name)[0], together.column(name)[row])
