"""Gaussian process class models over azimuth and elevation, and the plane as their special case."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from worlds.views.synthetic_views import FEATURES, expected_on_sphere, spherical_samples, synthetic_samples

from semantic_slam import Configuration, Engine, Keyframe
from semantic_slam.class_models.viewpoint_models import load_model
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.contracts.viewpoint_model import ViewpointModelContract
from semantic_slam.errors import InputError
from semantic_slam.training.viewpoint.fit import fit_samples
from semantic_slam.training.viewpoint.regression import fit_class, left_out_means
from semantic_slam.viewpoint.directions import Directions
from semantic_slam.viewpoint.gaussian_process import GaussianProcessModel
from semantic_slam.viewpoint.model import ViewpointModel, Viewpoints
from semantic_slam.viewpoint.novelty import KnownViews
from semantic_slam.viewpoint.outliers import OutlierScores
from semantic_slam.viewpoint.parametric import ParametricModel
from semantic_slam.viewpoint.spherical_process import SphericalProcessModel, spherical_posterior
from semantic_slam.viewpoint.store import read_model, save_model


@pytest.fixture(scope="module")
def fitted() -> SphericalProcessModel:
    return SphericalProcessModel(("one", "two"), FEATURES, [fit_class(spherical_samples(seed)) for seed in (0, 1)])


def from_directions(azimuth: np.ndarray, elevation: np.ndarray) -> Viewpoints:
    return Viewpoints(azimuth, elevation, np.ones_like(azimuth))


def somewhere(count: int) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(3)
    return random.uniform(-7.0, 7.0, count), random.uniform(-1.2, 1.5, count)


class TestSphericalProcess(ViewpointModelContract):
    @pytest.fixture
    def model(self, fitted: SphericalProcessModel) -> ViewpointModel:
        return fitted

    @pytest.mark.parametrize("other", [None, ParametricModel(0.6, 15.0)])
    def test_slopes_by_both_angles_are_differences(self, fitted: ViewpointModel, other: ViewpointModel | None) -> None:
        model, (azimuth, elevation), classes = other or fitted, somewhere(40), np.arange(40) % 2
        jacobian = model.predict(classes, from_directions(azimuth, elevation)).mean_jacobian
        for column, (around, up) in enumerate(((1e-6, 0.0), (0.0, 1e-6))):
            ends = [
                model.predict(classes, from_directions(azimuth + sign * around, elevation + sign * up)).mean
                for sign in (1.0, -1.0)
            ]
            np.testing.assert_allclose(jacobian[:, :, column], (ends[0] - ends[1]) / 2e-6, atol=1e-6)

    def test_the_patches_are_the_posterior(self, fitted: SphericalProcessModel) -> None:
        azimuth, elevation = somewhere(60)
        prediction = fitted.predict(np.zeros(60, dtype=int), from_directions(azimuth, elevation))
        for component in range(3):
            exact = spherical_posterior(fitted.fits[0], component, Directions(azimuth, elevation))
            np.testing.assert_allclose(prediction.mean[:, component], exact[0], atol=1e-4)
            np.testing.assert_allclose(prediction.mean_jacobian[:, component, 0], exact[1], atol=3e-3)
            np.testing.assert_allclose(prediction.mean_jacobian[:, component, 1], exact[2], atol=3e-3)

    def test_recovers_the_function_that_made_the_data(self, fitted: SphericalProcessModel) -> None:
        azimuth, elevation = np.linspace(0.0, 6.2, 30), np.tile([0.1, 0.4, 0.8], 10)
        mean = fitted.predict(np.zeros(30, dtype=int), from_directions(azimuth, elevation)).mean
        np.testing.assert_allclose(mean, expected_on_sphere(azimuth, elevation), atol=0.06)

    def test_from_straight_above_no_azimuth_counts(self, fitted: SphericalProcessModel) -> None:
        azimuth = np.linspace(-3.0, 3.0, 9)
        top = fitted.predict(np.zeros(9, dtype=int), from_directions(azimuth, np.full(9, 0.5 * np.pi)))
        np.testing.assert_allclose(top.mean, np.tile(top.mean[:1], (9, 1)), atol=1e-9)
        np.testing.assert_allclose(top.mean_jacobian[:, :, 0], 0.0, atol=1e-9)

    def test_where_nobody_looked_the_model_knows_less(self, fitted: SphericalProcessModel) -> None:
        seen = from_directions(np.zeros(3), np.array([0.2, -1.3, 1.5]))
        covered = fitted.in_coverage(np.zeros(3, dtype=int), seen)
        inside, below, _ = np.trace(fitted.predict(np.zeros(3, dtype=int), seen).covariance, axis1=1, axis2=2)
        assert covered.tolist() == [True, False, False] and below > 1.5 * inside

    def test_what_is_known_is_known_from_above(self, fitted: SphericalProcessModel) -> None:
        assert np.rad2deg(fitted.elevations_rad).tolist() == pytest.approx([0.0, 25.0, 50.0])
        above = fitted.predict(np.zeros(1, dtype=int), from_directions(np.ones(1), np.deg2rad([50.0]))).mean[0]
        assert KnownViews(fitted).explain(above, 1e-4 * np.eye(3))
        expected = 0.3 + 0.5 * np.sin(fitted.elevations_rad).mean()
        assert OutlierScores.of(fitted, 0.01).mean[1] == pytest.approx(expected, abs=0.05)

    def test_file_round_trip(self, fitted: SphericalProcessModel, tmp_path: Path) -> None:
        path = tmp_path / "models.safetensors"
        save_model(fitted, path, {})
        again, (azimuth, elevation) = read_model(path), somewhere(20)
        assert isinstance(again, SphericalProcessModel)
        first, second = (own.predict(np.arange(20) % 2, from_directions(azimuth, elevation)) for own in (fitted, again))
        for name in ("mean", "covariance", "mean_jacobian"):
            np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
        with pytest.raises(InputError, match="gp_independent"):
            load_model(SemanticModelConfiguration(kind="gp_correlated", path=str(path)))

    def test_a_planar_run_refuses_what_it_would_evaluate_from_the_wrong_height(
        self, fitted: SphericalProcessModel, tmp_path: Path
    ) -> None:
        save_model(fitted, path := tmp_path / "models.safetensors", {})
        own = {"association": "open", "semantic_model": {"kind": "gp_independent", "path": str(path)}}
        with pytest.raises(InputError, match="tells heights apart, which needs state_space: spatial; set that, or fit"):
            Engine(Configuration.of(**own)).process(Keyframe.planar(0))
        world = {"iterate_updates": True, "classes": "carried", "field_of_view_rad": 1.2}
        start = {"mean": [0.0] * 6, "sigma": [0.01] * 6}
        spatial = Engine(Configuration.of(**own, state_space="spatial", open_world=world, initial_pose=start))
        assert len(spatial.process(Keyframe.spatial(0)).objects) == 0


def test_views_of_one_height_are_those_of_the_plane_bit_for_bit() -> None:
    plain = synthetic_samples(0.0, seed=3)
    level = replace(plain, elevation_rad=np.full(len(plain.azimuth_rad), 0.3))
    flat, raised = (fit_samples({"one": own}, FEATURES).model for own in (plain, level))
    assert isinstance(raised, GaussianProcessModel)
    for item in fields(flat.fits[0]):
        np.testing.assert_array_equal(getattr(flat.fits[0], item.name), getattr(raised.fits[0], item.name))


@pytest.mark.parametrize(("heights_deg", "step_deg"), [((60, 55), 36), ((75, 70), 60), ((0, 30), 36), ((0,), 36)])
def test_steps_between_views_are_angles_on_the_sphere(heights_deg: tuple[int, ...], step_deg: int) -> None:
    """Views from above lie closer together than their azimuths, and do not cover the horizon."""
    azimuth = np.deg2rad(np.arange(0.0, 360.0, step_deg))
    lowest = np.deg2rad(min(heights_deg))
    step = 2.0 * np.arcsin(np.cos(lowest) * np.sin(np.deg2rad(0.5 * step_deg)))  # of the great circle
    samples = spherical_samples(0).select(np.arange(len(azimuth) * len(heights_deg)))
    told = np.repeat(np.deg2rad(np.array(heights_deg, dtype=np.float64)), len(azimuth))
    fit = fit_class(replace(samples, azimuth_rad=np.tile(azimuth, len(heights_deg)), elevation_rad=told))
    assert fit.coverage_rad == pytest.approx(1.5 * step, rel=0.05)
    if lowest == 0.0:
        assert fit.coverage_rad == pytest.approx(1.5 * np.deg2rad(step_deg), rel=1e-6)


def test_left_out_means_on_the_sphere_are_those_of_a_posterior_without_the_view(fitted: SphericalProcessModel) -> None:
    fit, index = fitted.fits[0], 31
    others = np.arange(fit.azimuth_rad.size) != index
    assert fit.elevation_rad is not None
    smaller = replace(
        fit,
        azimuth_rad=fit.azimuth_rad[others],
        elevation_rad=fit.elevation_rad[others],
        targets=fit.targets[others],
        target_variances=fit.target_variances[others],
    )
    at = Directions(fit.azimuth_rad[[index]], fit.elevation_rad[[index]])
    expected = [spherical_posterior(smaller, component, at)[0][0] for component in range(3)]
    np.testing.assert_allclose(left_out_means(fit)[index], expected, atol=1e-8)


def test_a_report_of_several_heights_is_calibrated() -> None:
    report = fit_samples({"one": spherical_samples(4)}, FEATURES).report["one"]
    assert report["coverage"]["heights_deg"] == [0.0, 25.0, 50.0]
    assert report["mean_squared_whitened_residual"] == pytest.approx(3.0, abs=0.8)
