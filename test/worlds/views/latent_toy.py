"""A latent world without pictures: features follow a known network of direction and descriptor, with known noise."""

from itertools import pairwise

import numpy as np

from semantic_slam.latent.direction import NUM_INPUTS
from semantic_slam.latent.latent_model import FeatureNoise, Instances, LatentModel
from semantic_slam.latent.smooth_network import Layer, SmoothNetwork
from semantic_slam.training.latent.views.feature_views import FeatureViews
from semantic_slam.viewpoint.model import Viewpoints

FEATURES, DIMENSIONS, INSTANCES = 10, 3, 6
SIGMA = 0.1


def toy_model(seed: int = 0, sigma: float = SIGMA) -> LatentModel:
    """A model with random networks and six instances; its features are worth something."""
    generator = np.random.default_rng(seed)
    noise = FeatureNoise(np.full(FEATURES, sigma), 1.0)
    names = tuple(f"thing_{index}" for index in range(INSTANCES))
    return LatentModel(
        decoder=random_network(generator, (NUM_INPUTS + DIMENSIONS, 16, 16, FEATURES)),
        encoder=random_network(generator, (FEATURES, 8, 2 * DIMENSIONS)),
        noise=noise,
        turntable_noise=noise,
        instances=Instances(names, generator.normal(size=(INSTANCES, DIMENSIONS))),
    )


def random_network(generator: np.random.Generator, sizes: tuple[int, ...]) -> SmoothNetwork:
    return SmoothNetwork(
        [
            Layer(generator.normal(size=(outputs, inputs)) / np.sqrt(inputs), 0.1 * generator.normal(size=outputs))
            for inputs, outputs in pairwise(sizes)
        ]
    )


def toy_directions(count: int, seed: int = 1) -> Viewpoints:
    generator = np.random.default_rng(seed)
    return Viewpoints(generator.uniform(-np.pi, np.pi, count), generator.uniform(0.1, 0.4, count), np.full(count, 2.0))


def toy_views(model: LatentModel, per_instance: int = 40, sigma: float = SIGMA, seed: int = 2) -> FeatureViews:
    """Views of all instances whose features have noise of that sigma."""
    generator = np.random.default_rng(seed)
    instance = np.repeat(np.arange(INSTANCES), per_instance)
    directions = toy_directions(len(instance), seed)
    mean = model.mean(directions, model.instances.descriptors[instance])
    return FeatureViews(model.instances.names, instance, directions, mean + sigma * generator.normal(size=mean.shape))
