"""The parametric and the Gaussian process models keep the contract, and what the latter promise beyond it."""

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save_file
from worlds.views.synthetic_views import FEATURES, synthetic_samples

from semantic_slam.class_models.viewpoint_models import load_model
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.contracts.viewpoint_model import ViewpointModelContract, looking_from
from semantic_slam.errors import InputError
from semantic_slam.training.viewpoint.calibration import residuals
from semantic_slam.training.viewpoint.fit import fit_samples
from semantic_slam.training.viewpoint.regression import LENGTH_BOUNDS, fit_class, gaussian_nll, left_out_means
from semantic_slam.training.viewpoint.samples import ClassSamples
from semantic_slam.viewpoint.gaussian_process import ClassFit, GaussianProcessModel, gram, posterior
from semantic_slam.viewpoint.model import ViewpointModel
from semantic_slam.viewpoint.novelty import KnownViews
from semantic_slam.viewpoint.parametric import ParametricModel
from semantic_slam.viewpoint.store import FORMAT, read_model, save_model


@pytest.fixture(scope="module")
def fitted() -> GaussianProcessModel:
    fits = [fit_class(synthetic_samples(phase, seed)) for seed, phase in enumerate((0.0, 1.0))]
    return GaussianProcessModel(("one", "two"), FEATURES, fits)


class TestParametric(ViewpointModelContract):
    @pytest.fixture
    def model(self) -> ViewpointModel:
        return ParametricModel(0.6, 15.0)

    def test_covers_every_direction(self, model: ViewpointModel) -> None:
        assert model.in_coverage(self.classes(model), looking_from(self.azimuths)).all()


class TestGaussianProcess(ViewpointModelContract):
    @pytest.fixture
    def model(self, fitted: GaussianProcessModel) -> ViewpointModel:
        return fitted

    def test_the_table_is_the_posterior(self, fitted: GaussianProcessModel) -> None:
        azimuths = np.linspace(0.0, 2.0 * np.pi, 1001)
        prediction = fitted.predict(np.zeros(1001, dtype=int), looking_from(azimuths))
        for component in range(3):
            mean, slope, _ = posterior(fitted.fits[0], component, azimuths)
            np.testing.assert_allclose(prediction.mean[:, component], mean, atol=1e-7)
            np.testing.assert_allclose(prediction.mean_jacobian[:, component, 0], slope, atol=1e-5)

    def test_recovers_the_function_that_made_the_data(self, fitted: GaussianProcessModel) -> None:
        azimuths = np.linspace(0.0, 2.0 * np.pi, 50)
        mean = fitted.predict(np.ones(50, dtype=int), looking_from(azimuths)).mean
        np.testing.assert_allclose(mean[:, 0], 0.5 + 0.4 * np.cos(azimuths + 1.0), atol=0.06)

    def test_noise_follows_the_direction(self, fitted: GaussianProcessModel) -> None:
        """The data's standard deviation is 0.125 in front and 0.025 behind, plus the floor."""
        covariance = fitted.predict(np.zeros(2, dtype=int), looking_from(np.array([0.0, np.pi]))).covariance
        front, back = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1)).mean(axis=-1)
        assert 0.10 < front < 0.16
        assert 0.02 < back < 0.06

    def test_left_out_means_are_those_of_a_posterior_without_the_view(self, fitted: GaussianProcessModel) -> None:
        fit, index = fitted.fits[0], 17
        others = np.arange(fit.azimuth_rad.size) != index
        smaller = replace(
            fit,
            azimuth_rad=fit.azimuth_rad[others],
            targets=fit.targets[others],
            target_variances=fit.target_variances[others],
        )
        expected = [posterior(smaller, component, fit.azimuth_rad[[index]])[0][0] for component in range(3)]
        np.testing.assert_allclose(left_out_means(fit)[index], expected, atol=1e-10)

    def test_new_data_whiten_to_unit_spread(self, fitted: GaussianProcessModel) -> None:
        fresh = residuals(fitted, 0, synthetic_samples(0.0, seed=99, draws=40)).summary()
        assert fresh["mean_squared_whitened_residual"] == pytest.approx(3.0, abs=0.6)
        assert fresh["fraction_within_1_sigma"] == pytest.approx(0.683, abs=0.06)

    def test_dropout_covariance_is_not_counted_twice(self) -> None:
        """When the dropout covariance explains the whole spread, the model's own noise sinks towards its floor."""
        data = synthetic_samples(0.0, seed=5, sigma=0.08)
        spread = (0.08 * (1.5 + np.cos(data.azimuth_rad))) ** 2
        explained = np.broadcast_to(spread[:, None, None, None] * np.eye(3), data.feature_covariances.shape)
        aware = fit_class(ClassSamples(data.azimuth_rad, data.features, np.array(explained)))
        blind = fit_class(data)
        assert np.trace(aware.noise_covariance[0]) < 0.35 * np.trace(blind.noise_covariance[0])

    def test_held_out_report_is_calibrated(self) -> None:
        report = fit_samples({"one": synthetic_samples(0.0, seed=3)}, FEATURES).report["one"]
        assert report["mean_squared_whitened_residual"] == pytest.approx(3.0, abs=0.6)
        assert report["coverage"] == {"views": 60.0, "widest_gap_deg": pytest.approx(6.0)}

    def test_a_gap_in_the_views_is_outside_the_coverage(self) -> None:
        data = synthetic_samples(0.0, seed=1)
        seen = data.select(np.abs(data.azimuth_rad - np.pi) > 1.0)
        model = GaussianProcessModel(("one",), FEATURES, [fit_class(seen)])
        inside = model.in_coverage(np.zeros(4, dtype=int), looking_from(np.array([0.0, -1.0, 2.1, np.pi])))
        assert inside.tolist() == [True, True, True, False]

    @pytest.mark.parametrize("seed", range(4))
    def test_no_other_kernel_is_likelier_where_features_change_quickly(self, seed: int) -> None:
        generator = np.random.default_rng(seed)
        azimuth = np.sort(generator.uniform(0.0, 2.0 * np.pi, 36))
        features = 0.3 + 0.1 * np.cos(9.0 * azimuth)[:, None, None] + 0.15 * generator.normal(size=(36, 8, 1))
        fit = fit_class(ClassSamples(azimuth, features, np.zeros((36, 8, 1, 1))))
        others = [
            replace(fit, signal_sigma=np.array([signal]), length_scale=np.array([length]))
            for signal in np.geomspace(0.01, 3.0, 15)
            for length in np.geomspace(*LENGTH_BOUNDS, 15)
        ]
        assert negative_log_evidence(fit) < min(map(negative_log_evidence, others)) + 0.1

    def test_features_that_no_class_shows_are_not_known(self, fitted: GaussianProcessModel) -> None:
        known, tight = KnownViews(fitted), 1e-4 * np.eye(3)
        mean = fitted.predict(np.zeros(8, dtype=int), looking_from(np.arange(8) * 0.7)).mean
        assert all(known.explain(feature, tight) for feature in mean)
        assert not known.explain(np.full(3, 4.0), tight)
        assert known.explain(np.full(3, 4.0), 100.0 * np.eye(3))  # nothing is said about it

    def test_only_directions_that_were_fitted_explain(self) -> None:
        data = synthetic_samples(0.0, seed=1)
        whole = GaussianProcessModel(("one",), FEATURES, [fit_class(data)])
        behind = whole.predict(np.zeros(1, dtype=int), looking_from(np.array([np.pi]))).mean[0]
        seen = data.select(np.cos(data.azimuth_rad) > 0.5)
        front = GaussianProcessModel(("one",), FEATURES, [fit_class(seen)])
        assert KnownViews(whole).explain(behind, 1e-6 * np.eye(3))
        assert not KnownViews(front).explain(behind, 1e-6 * np.eye(3))

    def test_file_round_trip(self, fitted: GaussianProcessModel, tmp_path: Path) -> None:
        path = tmp_path / "models.safetensors"
        save_model(fitted, path, {"seed": 3})
        again = read_model(path)
        assert again.class_names == ("one", "two")
        assert again.feature_names == FEATURES
        assert FORMAT.read(path)[1]["provenance"] == {"seed": 3}
        classes = self.classes(fitted)
        for name in ("mean", "covariance", "mean_jacobian"):
            first = getattr(fitted.predict(classes, looking_from(self.azimuths)), name)
            np.testing.assert_array_equal(first, getattr(again.predict(classes, looking_from(self.azimuths)), name))


def negative_log_evidence(fit: ClassFit) -> float:
    return gaussian_nll(fit.targets[:, 0] - fit.prior_mean[0], gram(fit, 0))


@pytest.mark.parametrize(
    "fault", ["missing", "not safetensors", "another file", "newer schema", "array left out", "nan"]
)
def test_wrong_model_files_are_named(fitted: GaussianProcessModel, tmp_path: Path, fault: str) -> None:
    path = tmp_path / "models.safetensors"
    description = {
        "schema_version": 1,
        "kind": "gp_independent",
        "class_names": ["one"],
        "feature_names": list(FEATURES),
    }
    arrays = {
        f"0.{item.name}": np.array(getattr(part, item.name))
        for part in (fitted.fits[0], fitted.tables[0])
        for item in fields(part)
        if getattr(part, item.name) is not None
    }
    if fault == "not safetensors":
        path.write_bytes(b"hello")
    elif fault != "missing":
        if fault == "another file":
            description = {}
        elif fault == "newer schema":
            description["schema_version"] = 2
        elif fault == "array left out":
            del arrays["0.targets"]
        elif fault == "nan":
            arrays["0.targets"][0, 0] = np.nan
        save_file(arrays, str(path), metadata={"semantic_slam": json.dumps(description)})
    with pytest.raises(InputError, match=r"models\.safetensors: .*") as error:
        read_model(path)
    assert "\n" not in str(error.value)


def test_the_configuration_chooses_the_model(fitted: GaussianProcessModel, tmp_path: Path) -> None:
    path = tmp_path / "models.safetensors"
    save_model(fitted, path, {})
    chosen = load_model(SemanticModelConfiguration(kind="gp_independent", path=str(path)))
    assert chosen is not None and chosen.class_names == ("one", "two")
    parametric = load_model(SemanticModelConfiguration(kind="parametric", alpha=0.5, class_names=("a", "b")))
    assert parametric == ParametricModel(0.5, 15.0, ("a", "b"))
    assert load_model(SemanticModelConfiguration(kind="none")) is None
    with pytest.raises(InputError, match="two classes"):
        load_model(SemanticModelConfiguration(kind="parametric", class_names=("a",)))


def test_the_shipped_models_load_and_cover_every_direction() -> None:
    model = load_model(SemanticModelConfiguration())
    assert model is not None and len(model.class_names) >= 3
    azimuths = np.linspace(-np.pi, np.pi, 100)
    for index in range(len(model.class_names)):
        assert model.in_coverage(np.full(100, index), looking_from(azimuths)).all()
