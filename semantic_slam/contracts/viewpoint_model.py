"""Contract test of viewpoint models P(z_sem | c, viewpoint): the test of a new model is a subclass."""

import numpy as np
import pytest

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.viewpoint.model import ViewpointModel, Viewpoints, log_likelihood


def looking_from(azimuth_rad: float | Array, elevation_rad: float = 0.2) -> Viewpoints:
    """Viewpoints at the given azimuths, slightly above the horizon, at 2 m range."""
    azimuths = np.atleast_1d(np.asarray(azimuth_rad, dtype=np.float64))
    return Viewpoints(azimuths, np.full(azimuths.shape, elevation_rad), np.full(azimuths.shape, 2.0))


class ViewpointModelContract:
    """Subclass and override the fixture ``model``; ``azimuths`` may be narrowed to where the model is smooth."""

    azimuths = np.linspace(-4.0, 4.0, 41)

    @pytest.fixture
    def model(self) -> ViewpointModel:
        """The model under test."""
        raise NotImplementedError("a subclass of the contract gives the fixture `model`")

    def classes(self, model: ViewpointModel) -> Index:
        """Class indices, one per azimuth, cycling through the classes."""
        return np.asarray(np.arange(self.azimuths.size) % len(model.class_names))

    def test_shapes(self, model: ViewpointModel) -> None:
        prediction = model.predict(self.classes(model), looking_from(self.azimuths))
        count, size = self.azimuths.size, model.num_features
        assert prediction.mean.shape == (count, size)
        assert prediction.covariance.shape == (count, size, size)
        assert prediction.mean_jacobian.shape == (count, size, 3)
        assert model.in_coverage(self.classes(model), looking_from(self.azimuths)).shape == (count,)

    def test_covariances_are_symmetric_and_positive(self, model: ViewpointModel) -> None:
        covariance = model.predict(self.classes(model), looking_from(self.azimuths)).covariance
        np.testing.assert_allclose(covariance, np.swapaxes(covariance, -1, -2), atol=1e-15)
        assert np.linalg.eigvalsh(covariance).min() > 0.0

    def test_jacobian_is_the_derivative_of_the_mean(self, model: ViewpointModel) -> None:
        classes, azimuths, step = self.classes(model), self.azimuths + 0.00123, 1e-6
        ahead = model.predict(classes, looking_from(azimuths + step)).mean
        behind = model.predict(classes, looking_from(azimuths - step)).mean
        jacobian = model.predict(classes, looking_from(azimuths)).mean_jacobian
        np.testing.assert_allclose(jacobian[:, :, 0], (ahead - behind) / (2.0 * step), atol=1e-6)

    def test_jacobian_by_elevation_is_that_of_the_mean(self, model: ViewpointModel) -> None:
        classes, azimuths, step = self.classes(model), self.azimuths + 0.00123, 1e-6
        above, below = (model.predict(classes, looking_from(azimuths, 0.2 + sign * step)).mean for sign in (1.0, -1.0))
        jacobian = model.predict(classes, looking_from(azimuths)).mean_jacobian
        np.testing.assert_allclose(jacobian[:, :, 1], (above - below) / (2.0 * step), atol=1e-6)

    def test_a_whole_turn_changes_nothing(self, model: ViewpointModel) -> None:
        here = model.predict(self.classes(model), looking_from(self.azimuths))
        around = model.predict(self.classes(model), looking_from(self.azimuths + 2.0 * np.pi))
        for name in ("mean", "covariance", "mean_jacobian"):
            np.testing.assert_allclose(getattr(here, name), getattr(around, name), atol=1e-9)

    def test_a_batch_is_its_rows(self, model: ViewpointModel) -> None:
        classes = self.classes(model)
        batch = model.predict(classes, looking_from(self.azimuths))
        for index in (0, 7, 40):
            single = model.predict(classes[index : index + 1], looking_from(self.azimuths[index]))
            np.testing.assert_allclose(single.mean[0], batch.mean[index], atol=1e-14)
            np.testing.assert_allclose(single.covariance[0], batch.covariance[index], atol=1e-14)

    def test_the_mean_of_a_class_is_likelier_than_anything_else_for_it(self, model: ViewpointModel) -> None:
        prediction = model.predict(np.array([1]), looking_from(0.7))
        size = model.num_features
        nothing = np.zeros((size, size))
        at_mean = log_likelihood(model, prediction.mean[0], nothing, looking_from(0.7))
        beside = log_likelihood(model, prediction.mean[0] + 0.1, nothing, looking_from(0.7))
        assert at_mean.shape == (len(model.class_names),)
        logdet = np.linalg.slogdet(prediction.covariance[0])[1]
        assert at_mean[1] == pytest.approx(-0.5 * (logdet + size * np.log(2.0 * np.pi)))
        assert beside[1] < at_mean[1]
