"""Contract test of learned descriptor models P(f | viewpoint, e): the test of a new model is a subclass."""

import numpy as np
import pytest

from semantic_slam.geometry.arrays import Array
from semantic_slam.latent.model import DescriptorBelief, DescriptorModel
from semantic_slam.viewpoint.model import Viewpoints

STEP = 1e-6


class DescriptorModelContract:
    """Subclass and override the fixture ``model``."""

    count = 20
    sensible_features = 32  # more features cost inference more than they contribute

    @pytest.fixture
    def model(self) -> DescriptorModel:
        """The model under test."""
        raise NotImplementedError("a subclass of the contract gives the fixture `model`")

    def viewpoints(self) -> Viewpoints:
        """Viewpoints at all azimuths (beyond one turn, too), from below and from above."""
        generator = np.random.default_rng(1)
        return Viewpoints(
            generator.uniform(-4.0, 4.0, self.count),
            generator.uniform(-0.4, 0.6, self.count),
            generator.uniform(0.5, 5.0, self.count),
        )

    def descriptors(self, model: DescriptorModel) -> Array:
        """Descriptors drawn from the prior, which is where the model was trained."""
        draws = np.random.default_rng(2).normal(size=(self.count, model.num_dimensions))
        return np.asarray(model.prior.mean + model.prior.sigma * draws)

    def test_shapes(self, model: DescriptorModel) -> None:
        features, dimensions = model.num_features, model.num_dimensions
        prediction = model.predict(self.viewpoints(), self.descriptors(model))
        assert 1 <= features <= self.sensible_features and dimensions >= 1
        assert prediction.mean.shape == prediction.sigma.shape == (self.count, features)
        assert prediction.by_direction.shape == (self.count, features, 2)
        assert prediction.by_descriptor.shape == (self.count, features, dimensions)
        assert model.prior.mean.shape == model.prior.sigma.shape == (1, dimensions)
        guess = model.encode(prediction.mean)
        assert guess.mean.shape == guess.sigma.shape == (self.count, dimensions)
        assert model.class_log_likelihood(guess).shape == (self.count, len(model.class_names))

    def test_mean_and_sigma_are_those_of_the_prediction(self, model: DescriptorModel) -> None:
        looked, descriptors = self.viewpoints(), self.descriptors(model)
        prediction = model.predict(looked, descriptors)
        mean, sigma = model.mean_and_sigma(looked, descriptors)
        np.testing.assert_allclose(mean, prediction.mean, atol=1e-9)
        np.testing.assert_allclose(sigma, prediction.sigma, atol=1e-9)

    def test_spreads_are_positive(self, model: DescriptorModel) -> None:
        prediction = model.predict(self.viewpoints(), self.descriptors(model))
        for sigma in (prediction.sigma, model.prior.sigma, model.encode(prediction.mean).sigma):
            assert np.all(sigma > 0.0)

    @pytest.mark.parametrize("axis", [0, 1], ids=["azimuth", "elevation"])
    def test_derivative_by_the_direction_is_that_of_differences(self, model: DescriptorModel, axis: int) -> None:
        looked, descriptors = self.viewpoints(), self.descriptors(model)
        ahead, behind = (model.predict(moved(looked, axis, step), descriptors).mean for step in (STEP, -STEP))
        by_direction = model.predict(looked, descriptors).by_direction
        np.testing.assert_allclose(by_direction[:, :, axis], (ahead - behind) / (2.0 * STEP), atol=1e-6)

    def test_derivative_by_the_descriptor_is_that_of_differences(self, model: DescriptorModel) -> None:
        looked, descriptors = self.viewpoints(), self.descriptors(model)
        by_descriptor = model.predict(looked, descriptors).by_descriptor
        for column, shift in enumerate(STEP * np.eye(model.num_dimensions)):
            ahead, behind = (model.predict(looked, descriptors + sign * shift).mean for sign in (1.0, -1.0))
            np.testing.assert_allclose(by_descriptor[:, :, column], (ahead - behind) / (2.0 * STEP), atol=1e-6)

    def test_only_the_direction_of_view_counts(self, model: DescriptorModel) -> None:
        """Predictions depend neither on whole turns of the azimuth nor on the range: a tight crop shows neither."""
        looked, descriptors = self.viewpoints(), self.descriptors(model)
        once_round = Viewpoints(looked.azimuth_rad + 2.0 * np.pi, looked.elevation_rad, 5.0 * looked.range_m)
        here, there = model.predict(looked, descriptors), model.predict(once_round, descriptors)
        for name in ("mean", "sigma", "by_direction", "by_descriptor"):
            np.testing.assert_allclose(getattr(here, name), getattr(there, name), atol=1e-9)

    def test_a_batch_is_its_rows(self, model: DescriptorModel) -> None:
        looked, descriptors = self.viewpoints(), self.descriptors(model)
        batch = model.predict(looked, descriptors)
        guesses = model.encode(batch.mean)
        scores = model.class_log_likelihood(guesses)
        for row in (slice(0, 1), slice(7, 8), slice(self.count - 1, self.count)):
            single = Viewpoints(looked.azimuth_rad[row], looked.elevation_rad[row], looked.range_m[row])
            np.testing.assert_allclose(model.predict(single, descriptors[row]).mean, batch.mean[row], atol=1e-12)
            guess = model.encode(batch.mean[row])
            np.testing.assert_allclose(guess.mean, guesses.mean[row], atol=1e-9)
            np.testing.assert_allclose(model.class_log_likelihood(guess), scores[row], atol=1e-9)

    def test_class_scores_are_numbers_whatever_the_doubt(self, model: DescriptorModel) -> None:
        for doubt in (1e-3, 1.0, 30.0):
            belief = DescriptorBelief(self.descriptors(model), np.full((self.count, model.num_dimensions), doubt))
            assert np.isfinite(model.class_log_likelihood(belief)).all()

    def test_the_space_has_a_name(self, model: DescriptorModel) -> None:
        """The space has a name, or none for a model without a file; by it the engine refuses maps of another space."""
        assert isinstance(model.space, str)


def moved(viewpoints: Viewpoints, axis: int, step: float) -> Viewpoints:
    """Azimuths (axis 0) or elevations (1) changed by ``step``."""
    by_azimuth, by_elevation = step * np.eye(2)[axis]
    return Viewpoints(viewpoints.azimuth_rad + by_azimuth, viewpoints.elevation_rad + by_elevation, viewpoints.range_m)
