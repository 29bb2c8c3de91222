"""Chapter 5's studies on views that the shipped model predicts itself, and on one rendered track."""

from pathlib import Path

import numpy as np
import pytest
from semantic_slam_lab.simulation.goods import goods_class, goods_names
from semantic_slam_lab.studies.ch5 import grounding, latent_space, likelihood, sensitivity
from semantic_slam_lab.studies.ch5.models import FORMULATIONS, NUM_GOODS, Shipped, known, new, trained
from semantic_slam_lab.studies.ch5.rasters import raster_figure
from semantic_slam_lab.studies.ch5.refinement import refinement_numbers
from semantic_slam_lab.studies.ch5.tracks import SIGMA_STEP, Drive, Located, located
from semantic_slam_lab.studies.ch5.views import named, validation_views
from semantic_slam_lab.studies.latent_slam.maps import unannotated, with_classes, with_instances

from semantic_slam.geometry import se2
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam.training.latent.fitting.refinement import RefinementSettings
from semantic_slam.training.latent.views.feature_views import FeatureViews
from semantic_slam.viewpoint.model import Viewpoints

DIRECTIONS = 8


@pytest.fixture(scope="module")
def shipped() -> Shipped:
    return trained("map")


def descriptor_of(shipped: Shipped, name: str) -> np.ndarray:
    """(L,) as learned."""
    instances = shipped.model.instances
    return instances.descriptors[instances.names.index(name)]


def predicted(shipped: Shipped, names: tuple[str, ...], noise: float) -> FeatureViews:
    """Views of known instances as the model expects them, with so many of its sigmas of noise."""
    azimuth = np.tile(np.linspace(-3.0, 3.0, DIRECTIONS), len(names))
    viewpoints = Viewpoints(azimuth, np.full(len(azimuth), 0.25), np.full(len(azimuth), 2.0))
    descriptors = np.repeat([descriptor_of(shipped, name) for name in names], DIRECTIONS, axis=0)
    prediction = shipped.model.predict(viewpoints, descriptors)
    scatter = np.random.default_rng(0).standard_normal(prediction.mean.shape) * prediction.sigma
    instance = np.repeat(np.arange(len(names)), DIRECTIONS)
    return FeatureViews(names, instance, viewpoints, prediction.mean + noise * scatter)


@pytest.mark.parametrize("name", FORMULATIONS)
def test_training_set_the_same_goods_aside_for_both_formulations(name: str) -> None:
    model = trained(name)
    goods = goods_names(NUM_GOODS)
    assert len(model.held_out) >= 8
    assert set(new(model, goods)) == set(new(trained("map"), goods))
    assert set(known(model, goods)) | set(new(model, goods)) == set(goods)


@pytest.mark.long
@pytest.mark.slow
def test_views_without_noise_are_explained_perfectly(shipped: Shipped) -> None:
    numbers = likelihood._of_known(shipped.model, predicted(shipped, known(shipped, goods_names(16)), 0.0), 0)
    assert numbers["peak_within_10deg"] == numbers["instance_identification"] == 1.0
    assert numbers["nees"] < 1e-6


@pytest.mark.long
@pytest.mark.slow
def test_noise_as_large_as_stated_is_consistent(shipped: Shipped) -> None:
    """NEES 1 only if the information of the ascent is that of the noise."""
    numbers = likelihood._of_known(shipped.model, predicted(shipped, known(shipped, goods_names(48)), 1.0), 0)
    assert numbers["nees"] == pytest.approx(1.0, abs=0.35)
    assert numbers["nees_untempered"] != numbers["nees"]


def test_claims_follow_the_numbers() -> None:
    good = dict.fromkeys((*likelihood.COLUMNS, "nees_band_low", "nees_band_high"), 1.0)
    bad = dict.fromkeys(good, 0.0)
    right = likelihood.claims({"map": good, "energy": good, "default": good})
    wrong = likelihood.claims({"map": bad, "energy": bad, "default": bad})
    assert all(claim.holds for claim in right)
    assert not any(claim.holds for claim in wrong[:7])


def test_no_claim_of_ascents_holds_where_none_helps() -> None:
    good = {"improved_fraction": 1.0, "median_error_deg": 1.0, "descriptor_improved_from_1_sigma": 1.0}
    bad = {"improved_fraction": 0.0, "median_error_deg": 90.0, "descriptor_improved_from_1_sigma": 0.0}
    right, wrong = (sensitivity.claims(dict.fromkeys(("map", "energy", "default"), own)) for own in (good, bad))
    assert all(claim.holds for claim in right) and not any(claim.holds for claim in wrong)


def test_ascents_are_judged_from_both_kinds_of_starts(shipped: Shipped) -> None:
    views = predicted(shipped, known(shipped, goods_names(16)), 0.3)
    numbers, wide = sensitivity.evaluated(shipped.model, views, 18.0, 0)
    assert numbers["improved_fraction"] > 0.9
    assert np.abs(wide.start_rad).max() <= np.deg2rad(sensitivity.LARGEST_DEG)
    assert numbers["descriptor_improved_from_2_sigma"] > 0.5


def test_untagged_instances_are_classified(shipped: Shipped) -> None:
    views = predicted(shipped, known(shipped, goods_names(NUM_GOODS)), 0.3)
    accuracy = grounding.judged(shipped.model, views, np.random.default_rng(0))
    assert set(accuracy) == set(grounding.METHODS)
    assert min(accuracy.values()) > 0.3  # an eighth by chance
    assert all(claim.measured for claim in grounding.claims(accuracy))


@pytest.mark.long
@pytest.mark.slow
def test_pages_have_their_pictures(shipped: Shipped, tmp_path: Path) -> None:
    names = known(shipped, goods_names(16))
    views = predicted(shipped, names, 0.3)
    encoded = shipped.model.encode(views.features).mean / shipped.model.prior.sigma
    numbers = latent_space.evaluated(shipped.model, views, encoded)
    assert numbers["nearest_view_same_instance"] > 0.5
    pictures = np.random.default_rng(0).integers(0, 255, (len(views), 32, 32, 3), dtype=np.uint8)
    figures = [
        latent_space._space(tmp_path / "space.png", "map", views, encoded, pictures, 0),
        latent_space._predictions(tmp_path / "means.png", "map", shipped.model, views, pictures, names[:1], 0),
    ]
    raster = raster_figure(
        tmp_path / "raster.png", shipped.model, views.chosen(np.array([3])), descriptor_of(shipped, names[0])
    )
    assert all(path.stat().st_size > 10_000 for path in (*(figure.file for figure in figures), raster))


def test_views_by_name_keep_their_features(shipped: Shipped) -> None:
    names = known(shipped, goods_names(16))
    views = predicted(shipped, names, 0.0)
    chosen = named(views, names[2:0:-1])
    np.testing.assert_array_equal(chosen.features[chosen.instance == 0], views.features[views.instance == 2])


@pytest.mark.slow
@pytest.mark.render
def test_validation_views_lie_between_those_that_trained() -> None:
    views = validation_views(["cooler_01"], 1, every_deg=120)
    angles = np.rad2deg([view.azimuth_rad for view in views]) % 12.0
    np.testing.assert_allclose(angles, 6.0, atol=1e-6)
    assert all(view.mask.any() for view in views)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.render
def test_learned_factor_mends_a_track(shipped: Shipped) -> None:
    run = located(known(shipped, goods_names(NUM_GOODS))[5], 0, 0, models=("map",))
    assert run.ratio("map") < 0.8
    assert set(run.estimates) == {"map", "map_descriptor_known"}


@pytest.mark.slow
def test_refinement_is_judged_on_tracks_that_it_has_not_seen(shipped: Shipped) -> None:
    """In the model's own world there is nothing to refine: errors and likelihoods stay about what they were."""
    goods = goods_names(NUM_GOODS)
    names = (known(shipped, goods)[3], known(shipped, goods)[9])
    runs = [small_track(shipped, name, number) for name in names for number in range(2)]
    numbers = refinement_numbers(runs, names[1:], "map", 1, RefinementSettings(steps=8))
    for group in ("trained", "new"):
        before, after = (numbers[f"{group}_objects_{when}_log_likelihood_per_view"] for when in ("before", "after"))
        assert abs(after - before) < 5.0
        assert numbers[f"{group}_objects_after_error_vs_dead_reckoning"] < 1.5


def small_track(shipped: Shipped, name: str, number: int) -> Located:
    """A quarter of a circle around an object whose features are those that the model expects, with some noise."""
    generator = np.random.default_rng(number)
    turns = number + np.linspace(0.0, 1.5, 5)
    truth = np.column_stack([2.0 * np.cos(turns), 2.0 * np.sin(turns), turns + np.pi / 2.0])
    directions = Viewpoints(turns, np.full(len(turns), 0.25), np.full(len(turns), 2.0))
    expected = shipped.model.predict(directions, np.tile(descriptor_of(shipped, name), (len(turns), 1)))
    features = expected.mean + 0.3 * expected.sigma * generator.standard_normal(expected.mean.shape)
    odometry = se2.between(truth[:-1], truth[1:]) + SIGMA_STEP * generator.standard_normal((len(turns) - 1, 3))
    reckoned = [truth[0]]
    for step in odometry:
        reckoned.append(se2.compose(reckoned[-1], step))
    drive = Drive(features, directions.elevation_rad, truth[0], odometry, np.zeros(3))
    ends = {"map": drive.smoothed(shipped.model, shipped.model.prior)}
    return Located(name, number, truth, np.array(reckoned), {"map": drive}, ends)


def test_maps_tell_poses_classes_or_instances(shipped: Shipped) -> None:
    instances = {1: known(shipped, goods_names(NUM_GOODS))[0], 2: new(shipped, goods_names(NUM_GOODS))[0]}
    entries = [
        ObjectPrior(
            object_id=n,
            name="",
            pose=np.array([0, 0, 0, 0, 0, 0, 1.0]),
            covariance=np.eye(6),
            class_probabilities={"x": 1.0},
        )
        for n in instances
    ]
    plain = unannotated(MapPrior(tuple(entries)))
    assert all(not entry.class_probabilities for entry in plain.objects)
    classes = with_classes(plain, instances).objects
    assert [entry.class_probabilities for entry in classes] == [{goods_class(name): 1.0} for name in instances.values()]
    told, untold = with_instances(plain, instances).objects
    np.testing.assert_allclose(told.descriptor, descriptor_of(shipped, instances[1]))
    assert len(untold.descriptor) == 0
