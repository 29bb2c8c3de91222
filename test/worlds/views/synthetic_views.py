"""Views of a class with smooth features: mean and spread are known in every direction."""

import numpy as np

from semantic_slam.training.viewpoint.samples import ClassSamples

FEATURES = ("first", "second", "third")


def synthetic_samples(phase: float, seed: int, views: int = 60, draws: int = 6, sigma: float = 0.05) -> ClassSamples:
    """Smooth features around the circle with independent noise of a known, azimuth-dependent spread."""
    generator = np.random.default_rng(seed)
    azimuth = np.arange(views) * 2.0 * np.pi / views
    truth = np.stack([0.5 + 0.4 * np.cos(azimuth + phase), 0.5 + 0.3 * np.sin(azimuth), 0.2 + 0.0 * azimuth], axis=-1)
    spread = sigma * (1.5 + np.cos(azimuth))[:, None, None]
    features = truth[:, None, :] + spread * generator.normal(size=(views, draws, 3))
    return ClassSamples(azimuth, features, np.zeros((views, draws, 3, 3)))


def spherical_samples(
    seed: int, heights_deg: tuple[float, ...] = (0.0, 25.0, 50.0), views: int = 24, draws: int = 6
) -> ClassSamples:
    """The like around an object at several heights: by the angle off its front, and by the height."""
    generator = np.random.default_rng(seed)
    azimuth = np.tile(np.arange(views) * 2.0 * np.pi / views, len(heights_deg))
    elevation = np.repeat(np.deg2rad(heights_deg), views)
    features = expected_on_sphere(azimuth, elevation)[:, None] + 0.05 * generator.normal(size=(len(azimuth), draws, 3))
    return ClassSamples(azimuth, features, np.zeros((len(azimuth), draws, 3, 3)), elevation)


def expected_on_sphere(azimuth: np.ndarray, elevation: np.ndarray) -> np.ndarray:
    """(M, 3) features from there."""
    front, up = np.cos(azimuth) * np.cos(elevation), np.sin(elevation)
    return np.stack([0.5 + 0.4 * front, 0.3 + 0.5 * up, 0.2 + 0.0 * up], axis=-1)
