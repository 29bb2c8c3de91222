"""Contract test of geometric observation models: subclasses supply state spaces, detections and states."""

from collections.abc import Sequence
from typing import Any

import gtsam
import numpy as np
import pytest

from semantic_slam.contracts.state_space import COUNT, differences
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.states.keys import object_key, robot_key
from semantic_slam.inference.states.spaces import Spaces

KEYS = robot_key(0), object_key(4)


class GeometryModelContract:
    """Subclasses supply the model, its spaces and two detections, and sample matching robots and landmarks."""

    spaces: Spaces
    model: ObservationModel
    detections: Sequence[Any]

    def pairs(self, random: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Robot and landmark states, (count, s) each."""
        raise NotImplementedError

    @pytest.fixture
    def random(self) -> np.random.Generator:
        return np.random.default_rng(2)

    @property
    def seen(self) -> Any:
        """The first detection, collected for any number of state rows."""
        return self.model.collect(self.detections[:1])

    def test_sizes(self, random: np.random.Generator) -> None:
        part = self.model.geometry(self.seen, *self.pairs(random, COUNT))
        size = part.residual.shape[1]
        assert part.jacobian_robot.shape == (COUNT, size, self.spaces.layout.robot)
        assert part.jacobian_object.shape == (COUNT, size, self.spaces.layout.landmark)
        assert part.log_normaliser.shape == (COUNT,)

    def test_slopes_by_differences(self, random: np.random.Generator) -> None:
        (x, o), robot, landmark = self.pairs(random, COUNT), self.spaces.robot, self.spaces.landmark
        part = self.model.geometry(self.seen, x, o)
        by_robot = differences(
            lambda step: self.model.geometry(self.seen, robot.retract(x, step), o).residual, robot.tangent_size
        )
        by_object = differences(
            lambda step: self.model.geometry(self.seen, x, landmark.retract(o, step)).residual, landmark.tangent_size
        )
        np.testing.assert_allclose(part.jacobian_robot, by_robot, atol=2e-6)
        np.testing.assert_allclose(part.jacobian_object, by_object, atol=2e-6)

    def test_the_likelihood_is_what_the_linearisation_says(self, random: np.random.Generator) -> None:
        x, o = self.pairs(random, COUNT)
        part = self.model.geometry(self.seen, x, o)
        expected = part.log_normaliser - 0.5 * (part.residual**2).sum(axis=-1)
        np.testing.assert_allclose(self.model.log_likelihood(self.seen, x, o, None), expected, atol=1e-9)

    def test_gtsam_s_factor_is_the_whitened_residual(self, random: np.random.Generator) -> None:
        """GTSAM's factor agrees in its error and in its first-order derivatives by robot and landmark."""
        for detection in self.detections:
            seen = self.model.collect([detection])
            x, o = self.pairs(random, 1)
            part, values = self.model.geometry(seen, x, o), gtsam.Values()
            self.spaces.robot.insert(values, KEYS[0], x[0])
            self.spaces.landmark.insert(values, KEYS[1], o[0])
            factor = self.model.geometry_factor(detection, KEYS)
            assert factor.error(values) == pytest.approx(0.5 * float((part.residual**2).sum()), rel=1e-9)
            jacobian, right = factor.linearize(values).jacobian()
            expected = np.hstack([part.jacobian_robot[0], part.jacobian_object[0]])
            np.testing.assert_allclose(jacobian.T @ jacobian, expected.T @ expected, atol=1e-6)
            np.testing.assert_allclose(-jacobian.T @ right, expected.T @ part.residual[0], atol=1e-6)

    def test_rows_of_a_batch_are_single_states(self, random: np.random.Generator) -> None:
        x, o = self.pairs(random, COUNT)
        together = self.model.geometry(self.seen, x, o)
        for row in range(COUNT):
            alone = self.model.geometry(self.seen, x[row : row + 1], o[row : row + 1])
            for name, values in vars(together).items():
                np.testing.assert_allclose(getattr(alone, name)[0], values[row], atol=1e-12)

    def test_rows_of_several_detections_repeat(self, random: np.random.Generator) -> None:
        """State row b belongs to detection b mod S."""
        x, o = self.pairs(random, 6)
        together = self.model.geometry(self.model.collect(self.detections), x, o)
        logs = self.model.log_likelihood(self.model.collect(self.detections), x, o, None)
        for number, detection in enumerate(self.detections):
            rows, seen = np.arange(number, 6, len(self.detections)), self.model.collect([detection])
            alone = self.model.geometry(seen, x[rows], o[rows])
            for name, values in vars(together).items():
                np.testing.assert_allclose(values[rows], getattr(alone, name), atol=1e-12)
            own = self.model.log_likelihood(seen, x[rows], o[rows], None)
            np.testing.assert_allclose(logs[rows], own, atol=1e-12)

    def test_taken_detections_are_those_collected_alone(self, random: np.random.Generator) -> None:
        x, o = self.pairs(random, COUNT)
        every = self.model.collect(self.detections)
        for number, detection in enumerate(self.detections):
            taken, alone = (
                self.model.geometry(seen, x, o)
                for seen in (every.take(np.array([number])), self.model.collect([detection]))
            )
            for name, values in vars(taken).items():
                np.testing.assert_array_equal(values, getattr(alone, name))

    def test_a_search_starts_where_the_detection_is_explained(self, random: np.random.Generator) -> None:
        x, o = self.pairs(random, COUNT)
        start = self.model.robot_start(self.seen, x, o)
        assert start.shape == x.shape
        before, after = (self.model.log_likelihood(self.seen, at, o, None) for at in (x, start))
        assert (after >= before - 1e-9).all()

    def test_a_new_object_is_where_its_detection_points(self, random: np.random.Generator) -> None:
        x, _ = self.pairs(random, 1)
        for detection in self.detections:
            prior = self.model.object_prior(detection, x[0])
            size = self.spaces.landmark.tangent_size
            assert prior.mean.shape == (self.spaces.landmark.storage_size,)
            assert prior.covariance.shape == (size, size)
            part = self.model.geometry(self.model.collect([detection]), x, prior.mean[None])
            np.testing.assert_allclose(part.residual, 0.0, atol=1e-6)

    def test_no_cost_is_above_that_of_any_deviation(self, random: np.random.Generator) -> None:
        """The lower bound on a detection's cost holds for robots and landmarks sampled around their predictions."""
        x, o = self.pairs(random, 1)
        r, size = self.spaces.layout.robot, self.spaces.landmark.tangent_size
        seen = self.model.collect(self.detections)
        cost, log_peak = self.model.least_cost(seen, x, np.eye(r)[None] * 0.04, o[None], np.array([0.2]))
        assert cost.shape == (1, len(self.detections), 1)
        draws = random.standard_normal((2000, r + size))
        robots = self.spaces.robot.retract(np.tile(x, (2000, 1)), 0.2 * draws[:, :r])
        landmarks = self.spaces.landmark.retract(np.tile(o, (2000, 1)), 0.2 * draws[:, r:])
        peaks = []
        for number, detection in enumerate(self.detections):
            own = self.model.collect([detection])
            peak = self.model.geometry(own, x, o).log_normaliser[0]
            loss = peak - self.model.log_likelihood(own, robots, landmarks, None) + 0.5 * (draws**2).sum(axis=1)
            assert cost[0, number, 0] <= loss.min() + 1e-9
            peaks.append(peak)
        assert log_peak == pytest.approx(sum(peaks)) or not cost.any()
