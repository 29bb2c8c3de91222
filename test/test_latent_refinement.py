"""Eq. 5.20: parameters and poses of a batch of tracks climb one posterior."""

from dataclasses import replace

import numpy as np
from latent_toy import INSTANCES, toy_model, toy_views

from semantic_slam.latent.latent_model import LatentModel
from semantic_slam.latent.refinement import RefinementSettings, Track, estimate_track, refined
from semantic_slam.latent.smooth_network import Layer, SmoothNetwork
from semantic_slam.viewpoint.model import Viewpoints

VIEWS = 24


def drifting_tracks(world: LatentModel, sigma: float, seed: int = 0) -> tuple[list[Track], list[np.ndarray]]:
    """A round trip about every object: true azimuths, and told ones that wander off by ``sigma`` a step."""
    generator = np.random.default_rng(seed)
    tracks, truths = [], []
    covariance = sigma**2 * np.minimum.outer(np.arange(1, VIEWS + 1), np.arange(1, VIEWS + 1)).astype(float)
    for index in range(INSTANCES):
        truth = np.linspace(-3.0, 3.0, VIEWS)
        looked = Viewpoints(truth, np.full(VIEWS, 0.2), np.full(VIEWS, 2.0))
        descriptor = world.instances.descriptors[index]
        mean = world.mean(looked, np.tile(descriptor, (VIEWS, 1)))
        told = truth + np.cumsum(sigma * generator.normal(size=VIEWS))
        features = mean + world.noise.sigma * generator.normal(size=mean.shape)
        tracks.append(Track(features, replace(looked, azimuth_rad=told), covariance, descriptor))
        truths.append(truth)
    return tracks, truths


def errors(model: LatentModel, tracks: list[Track], truths: list[np.ndarray]) -> float:
    ends = [estimate_track(model, track).azimuth_rad - truth for track, truth in zip(tracks, truths, strict=True)]
    return float(np.sqrt(np.mean(np.square(ends))))


def test_a_track_is_found_better_than_it_was_told() -> None:
    world = toy_model()
    tracks, truths = drifting_tracks(world, 0.05)
    told = [track.told.azimuth_rad - truth for track, truth in zip(tracks, truths, strict=True)]
    assert errors(world, tracks, truths) < 0.5 * np.sqrt(np.mean(np.square(told)))


def test_parameters_refined_on_tracks_explain_the_world_better() -> None:
    world = toy_model()
    tracks, truths = drifting_tracks(world, 0.02)
    generator = np.random.default_rng(1)
    spoilt = SmoothNetwork(
        [
            Layer(layer.weight + 0.04 * generator.normal(size=layer.weight.shape), layer.bias)
            for layer in world.decoder.layers
        ]
    )
    model = replace(world, decoder=spoilt)
    trained_on = toy_views(world, per_instance=2, seed=9)
    better = refined(model, tracks, trained_on, RefinementSettings(rounds=3, steps=150, learning_rate=2e-3))
    fresh = toy_views(world, per_instance=60, sigma=0.0, seed=4)

    def misfit(judged: LatentModel) -> float:
        own = world.instances.descriptors[fresh.instance]
        return float(np.square(judged.mean(fresh.viewpoints, own) - fresh.features).mean())

    assert misfit(better) < 0.7 * misfit(model)
    assert errors(better, tracks, truths) < errors(model, tracks, truths)
