"""What is inferred from features and how sure it is: ascents, descriptors, calibration, grounded classes."""

from dataclasses import replace

import numpy as np
import pytest
from worlds.views.latent_toy import (
    DIMENSIONS,
    FEATURES,
    INSTANCES,
    SIGMA,
    toy_model,
    toy_views,
)

from semantic_slam.errors import InputError
from semantic_slam.latent.latent_model import LatentModel
from semantic_slam.latent.model import DescriptorBelief
from semantic_slam.training.latent.fitting.class_grounding import ground, nearest_class
from semantic_slam.training.latent.judging.calibration import feature_noise
from semantic_slam.training.latent.judging.estimation import (
    DescriptorEstimate,
    ascend_azimuth,
    azimuth_in_doubt,
    azimuth_raster,
    infer_descriptors,
)
from semantic_slam.training.latent.judging.evaluation import (
    azimuth_peaks,
    consistency,
    descriptors_from_views,
    identification,
    identification_of_groups,
    local_ascent,
    nees,
    nees_in_doubt,
    nees_tempered_by_others,
    one_of_each_direction,
    own_descriptors,
)
from semantic_slam.training.latent.views.feature_views import turned


@pytest.fixture(scope="module")
def model() -> LatentModel:
    return toy_model()


def test_ascent_finds_the_azimuth_of_a_noiseless_view(model: LatentModel) -> None:
    views = toy_views(model, sigma=0.0)
    start = turned(views.viewpoints, np.deg2rad(8.0))
    end = ascend_azimuth(model, start, own_descriptors(model, views), views.features)
    errors = np.abs(end.azimuth_rad - views.viewpoints.azimuth_rad)
    assert np.median(errors) < 1e-4
    assert (errors < np.deg2rad(1.0)).mean() > 0.9


def test_ascent_never_ends_lower_than_it_started(model: LatentModel) -> None:
    views = toy_views(model)
    descriptors, start = own_descriptors(model, views), turned(views.viewpoints, 1.0)
    end = ascend_azimuth(model, start, descriptors, views.features).azimuth_rad
    here = np.zeros(1)
    before = azimuth_raster(model, start, descriptors, views.features, here)
    after = azimuth_raster(model, turned(start, end - start.azimuth_rad), descriptors, views.features, here)
    assert np.all(after >= before)
    assert (after > before).mean() > 0.95


def test_peaks_and_identification_on_the_models_own_world(model: LatentModel) -> None:
    views = toy_views(model)
    descriptors = own_descriptors(model, views)
    assert (np.abs(azimuth_peaks(model, views, descriptors)) < np.deg2rad(10.0)).mean() > 0.9
    assert local_ascent(model, views, descriptors, 0.2, np.random.default_rng(0)).improved_fraction > 0.8
    assert identification(model, views).mean() > 0.9
    assert identification_of_groups(model, views, 5, 0.2, np.random.default_rng(0)).mean() > 0.9


def test_another_objects_descriptor_gives_wrong_peaks(model: LatentModel) -> None:
    views = toy_views(model)
    wrong = own_descriptors(model, views)[::-1]
    assert (np.abs(azimuth_peaks(model, views, wrong)) < np.deg2rad(10.0)).mean() < 0.7


def test_descriptors_are_inferred_from_a_few_views(model: LatentModel) -> None:
    inferred = descriptors_from_views(model, toy_views(model, sigma=0.02), 5, np.random.default_rng(0))
    assert len(inferred.views) == INSTANCES * 35
    error = np.abs(inferred.of_object.mean - model.instances.descriptors)
    assert np.median(error / inferred.of_object.sigma) < 2.0
    assert np.median(error) < 0.3 * model.prior.sigma.mean()


def test_an_inferred_descriptor_leaves_doubt_about_the_direction(model: LatentModel) -> None:
    """Features as noisy as the model says, descriptors from two views: errors are as large as told only with doubt."""
    views = toy_views(model, per_instance=80)
    inferred = [descriptors_from_views(model, views, 2, np.random.default_rng(seed)) for seed in range(6)]
    exact = np.mean([nees(model, each.views, each.descriptors).nees for each in inferred])
    in_doubt = np.mean([nees_in_doubt(model, each).nees for each in inferred])
    assert exact > 1.5
    assert in_doubt == pytest.approx(1.0, abs=0.35)
    assert np.mean([nees_tempered_by_others(model, each).nees for each in inferred]) == pytest.approx(1.0, abs=0.5)


def test_a_certain_descriptor_leaves_the_ascent_as_it_is(model: LatentModel) -> None:
    views = toy_views(model, per_instance=10)
    own = own_descriptors(model, views)
    certain = np.tile(1e-12 * np.eye(DIMENSIONS), (len(own), 1, 1))
    estimate = DescriptorEstimate(own, np.full(own.shape, 1e-6), certain)
    plain = ascend_azimuth(model, views.viewpoints, own, views.features)
    together = azimuth_in_doubt(model, views.viewpoints, estimate, views.features)
    np.testing.assert_allclose(together.azimuth_rad, plain.azimuth_rad, atol=1e-3)
    np.testing.assert_allclose(together.variance, plain.variance, rtol=1e-2)


def test_more_views_leave_less_doubt(model: LatentModel) -> None:
    views = toy_views(model)
    rows = np.flatnonzero(views.instance == 0)
    few, many = (
        infer_descriptors(model, chosen.viewpoints, chosen.features[None])
        for chosen in (views.chosen(rows[:2]), views.chosen(rows[:20]))
    )
    assert np.all(many.sigma < few.sigma)


def test_nees_is_one_for_the_true_sigma_and_four_for_half_of_it(model: LatentModel) -> None:
    views = toy_views(model, per_instance=150)
    descriptors = own_descriptors(model, views)
    right = nees(model, views, descriptors, np.full(FEATURES, SIGMA))
    half = nees(model, views, descriptors, np.full(FEATURES, SIGMA / 2.0))
    assert right.nees == pytest.approx(1.0, abs=0.25)
    assert half.nees == pytest.approx(4.0 * right.nees, rel=1e-3)
    assert not half.consistent


def test_band_of_consistency() -> None:
    # Chi-square with one degree of freedom has variance 2: the average of 800 lies within 1.96 * sqrt(2 / 800) = 0.098.
    low, high = consistency(np.ones(800)).band
    assert (low, high) == pytest.approx((0.902, 1.098), abs=0.008)


def test_one_view_is_left_of_each_direction(model: LatentModel) -> None:
    views = toy_views(model, per_instance=4)
    twice = views.chosen(np.repeat(np.arange(len(views)), 3))
    left = one_of_each_direction(twice, np.random.default_rng(0))
    assert len(left) == len(views)
    assert set(left.viewpoints.azimuth_rad) == set(views.viewpoints.azimuth_rad)


def test_calibration_finds_sigma_and_tempers_until_nees_is_one(model: LatentModel) -> None:
    views = toy_views(model, per_instance=100, sigma=0.07)
    noise = feature_noise(model, views)
    np.testing.assert_allclose(noise.sigma, 0.07, rtol=0.15)
    tempered = nees(replace(model, noise=noise), views, own_descriptors(model, views))
    assert tempered.nees == pytest.approx(1.0, abs=0.05)  # the few views far off count for less than they are


def test_grounded_classes_of_untagged_instances() -> None:
    generator = np.random.default_rng(0)
    centres = {"cup": np.array([2.0, 0.0]), "box": np.array([-2.0, 0.0])}
    names = [f"{name}_{index}" for name in centres for index in range(6)]
    descriptors = np.array([centres[name.split("_")[0]] + 0.4 * generator.normal(size=2) for name in names])
    tags = {name: name.split("_")[0] for name in names if name.endswith(("_0", "_1"))}
    grounding = ground(names, descriptors, tags)
    belief = DescriptorBelief(descriptors, np.full_like(descriptors, 0.1))
    best = [grounding.class_names[index] for index in grounding.log_likelihood(belief).argmax(axis=1)]
    truth = [name.split("_")[0] for name in names]
    assert best == truth
    assert nearest_class(names, descriptors, tags, descriptors) == truth


def test_a_doubtful_descriptor_says_less_about_its_class() -> None:
    descriptors = np.array([[1.0], [1.2], [-1.0], [-1.2]])
    grounding = ground("abcd", descriptors, {"a": "one", "b": "one", "c": "two", "d": "two"})
    sure, unsure = (
        grounding.log_likelihood(DescriptorBelief(np.array([[1.0]]), np.array([[sigma]])))[0] for sigma in (0.1, 3.0)
    )
    assert sure[0] - sure[1] > unsure[0] - unsure[1] > 0.0


def test_tags_of_unknown_instances_are_bad_input() -> None:
    with pytest.raises(InputError, match="name none of the instances"):
        ground(["a"], np.zeros((1, 2)), {"b": "cup"})
