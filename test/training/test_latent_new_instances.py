"""What a latent model says of objects that it was not fitted to, from leaving trained ones out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from semantic_slam.latent.latent_model import FeatureNoise, Instances, LatentModel
from semantic_slam.latent.smooth_network import Layer, SmoothNetwork
from semantic_slam.latent.store import read_latent_model, save_latent_model
from semantic_slam.training.latent.fitting.map_training import Fitted, MapSettings, fit_map
from semantic_slam.training.latent.fitting.torch_network import exported, tanh_network
from semantic_slam.training.latent.judging.calibration import mean_squared
from semantic_slam.training.latent.judging.evaluation import descriptors_from_views, squared_in_doubt
from semantic_slam.training.latent.judging.new_instances import VIEWS_OF_NEW, LeftOut, folds_of, new_factor
from semantic_slam.training.latent.views.feature_views import FeatureViews
from semantic_slam.viewpoint.model import Viewpoints

SIZE, DIMENSIONS, VIEWS = 6, 2, 18


def turning_things(count: int, seed: int) -> FeatureViews:
    """Each thing has a shape of its own: harmonics of the azimuth with coefficients by lot, and a little noise."""
    generator = np.random.default_rng(seed)
    azimuth = np.tile(np.linspace(-np.pi, np.pi, VIEWS, endpoint=False), count)
    waves = np.stack([np.cos(azimuth), np.sin(azimuth), np.cos(2.0 * azimuth)], axis=1)
    shapes = np.repeat(generator.normal(size=(count, 3, SIZE)), VIEWS, axis=0)
    features = np.einsum("nw,nwf->nf", waves, shapes) + 0.01 * generator.normal(size=(count * VIEWS, SIZE))
    viewpoints = Viewpoints(azimuth, np.zeros(len(azimuth)), np.ones(len(azimuth)))
    return FeatureViews(
        tuple(f"{n:02d}" for n in range(count)), np.repeat(np.arange(count), VIEWS), viewpoints, features
    )


def untrained(views: FeatureViews) -> LatentModel:
    """A model of the right shape that knows nothing, and is very sure of it."""
    noise = FeatureNoise(np.full(SIZE, 0.05), 1.0)
    return LatentModel(
        decoder=exported(tanh_network((13 + DIMENSIONS, 24, SIZE))),
        encoder=SmoothNetwork([Layer(np.zeros((2 * DIMENSIONS, SIZE)), np.zeros(2 * DIMENSIONS))]),
        noise=noise,
        turntable_noise=noise,
        instances=Instances(views.names, np.random.default_rng(0).normal(size=(len(views.names), DIMENSIONS))),
    )


def fitted(views: FeatureViews) -> LatentModel:
    """The model that all of the views teach."""
    model = untrained(views)
    start = Fitted(model.decoder, model.instances.descriptors)
    found = fit_map(views, start, MapSettings(steps=250, learning_rate=5e-3))
    return replace(model, decoder=found.decoder, instances=Instances(views.names, found.descriptors))


def of_things(views: FeatureViews, names: tuple[str, ...]) -> FeatureViews:
    numbers = [views.names.index(name) for name in names]
    rows = views.chosen(np.isin(views.instance, numbers))
    return FeatureViews(names, np.searchsorted(numbers, rows.instance), rows.viewpoints, rows.features)


def test_left_out_things_make_the_azimuth_of_new_ones_as_sure_as_it_is_right() -> None:
    views, strangers = turning_things(9, seed=1), turning_things(6, seed=2)
    parts = []
    for out in folds_of(views.names):
        rest = tuple(name for name in views.names if name not in out)
        parts.append(LeftOut(fitted(of_things(views, rest)), of_things(views, out)))
    model = replace(fitted(views), new_factor=new_factor(parts))
    sure, widened = (
        squared_in_doubt(own, descriptors_from_views(own, strangers, VIEWS_OF_NEW, np.random.default_rng(3)))
        for own in (model, model.on_new_instances())
    )
    assert sure.mean() > 5.0
    assert 0.2 < widened.mean() < 4.0


def test_too_few_things_tell_nothing_of_new_ones() -> None:
    assert folds_of(("a", "b", "c", "d", "e")) == []
    assert new_factor([]) is None
    model = untrained(turning_things(2, seed=1))
    assert model.on_new_instances() is model


def test_a_file_keeps_the_factor_of_new_things(tmp_path: Path) -> None:
    model = untrained(turning_things(2, seed=1))
    for name, own in (("without", model), ("with", replace(model, new_factor=2.5))):
        file = tmp_path / f"{name}.safetensors"
        save_latent_model(own, {}, file)
        assert read_latent_model(file).new_factor == own.new_factor
    np.testing.assert_allclose(read_latent_model(file).on_new_instances().noise.tempered, 2.5 * model.noise.tempered)


def test_folds_leave_every_thing_out_once() -> None:
    names = tuple("abcdefgh")
    assert sorted(name for fold in folds_of(names) for name in fold) == sorted(names)


def test_a_single_view_at_another_peak_does_not_widen_all_others() -> None:
    squared = np.random.default_rng(4).chisquare(1, 2000)
    assert mean_squared(squared) == pytest.approx(squared.mean(), rel=0.02)
    squared[0] = 5000.0
    assert mean_squared(squared) == pytest.approx(1.0, abs=0.1)
