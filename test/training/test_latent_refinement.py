"""Eq. 5.20: parameters and poses of a batch of tracks climb one posterior."""

from dataclasses import replace

import numpy as np
import pytest
from worlds.views.latent_toy import INSTANCES, toy_model, toy_views

from semantic_slam.latent.latent_model import LatentModel
from semantic_slam.latent.smooth_network import Layer, SmoothNetwork
from semantic_slam.training.latent.fitting.refinement import LocatedViews, RefinementSettings, refined
from semantic_slam.training.latent.judging.estimation import ascend_azimuth
from semantic_slam.training.latent.views.feature_views import turned
from semantic_slam.viewpoint.model import Viewpoints

VIEWS = 24


@pytest.mark.slow
def test_parameters_refined_on_tracks_explain_the_world_better() -> None:
    world = toy_model()
    generator = np.random.default_rng(1)
    spoilt = replace(
        world,
        space="spoilt",
        decoder=SmoothNetwork(
            [
                Layer(layer.weight + 0.04 * generator.normal(size=layer.weight.shape), layer.bias)
                for layer in world.decoder.layers
            ]
        ),
    )
    truth = np.tile(np.linspace(-3.0, 3.0, VIEWS), INSTANCES)
    looked = Viewpoints(truth, np.full(len(truth), 0.2), np.full(len(truth), 2.0))
    descriptors = np.repeat(world.instances.descriptors, VIEWS, axis=0)
    features = world.mean(looked, descriptors) + world.noise.sigma * generator.normal(size=(len(truth), 10))
    told = turned(looked, 0.05 * generator.normal(size=len(truth)))

    def localise(model: LatentModel) -> LocatedViews:
        azimuth = ascend_azimuth(model, told, descriptors, features).azimuth_rad
        return LocatedViews(features, turned(told, azimuth - told.azimuth_rad), descriptors)

    better = refined(spoilt, localise, RefinementSettings(steps=120, learning_rate=4e-3, rehearsal=0.2))
    fresh = toy_views(world, per_instance=60, sigma=0.0, seed=4)

    def misfit(model: LatentModel) -> float:
        own = world.instances.descriptors[fresh.instance]
        return float(np.square(model.mean(fresh.viewpoints, own) - fresh.features).mean())

    def error(model: LatentModel) -> float:
        return float(np.square(localise(model).viewpoints.azimuth_rad - truth).mean())

    assert misfit(better) < 0.7 * misfit(spoilt)
    assert error(better) < error(spoilt)
    assert better.space == ""


@pytest.mark.slow
def test_rehearsal_keeps_what_tracks_do_not_show() -> None:
    """Tracks that show one object alone, and wrongly: without rehearsal the others are spoilt too."""
    world = toy_model()
    views = toy_views(world, per_instance=30)
    own = views.chosen(views.instance == 0)
    shown = LocatedViews(own.features + 1.0, own.viewpoints, np.tile(world.instances.descriptors[0], (len(own), 1)))
    others = views.chosen(views.instance > 0)
    descriptors = world.instances.descriptors[others.instance]

    def moved(rehearsal: float) -> float:
        settings = RefinementSettings(rounds=1, steps=60, learning_rate=4e-3, rehearsal=rehearsal)
        after = refined(world, lambda model: shown, settings)
        change = after.mean(others.viewpoints, descriptors) - world.mean(others.viewpoints, descriptors)
        return float(np.square(change).mean())

    assert moved(1.0) < 0.5 * moved(0.0)
