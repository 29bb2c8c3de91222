"""The model over changes of viewpoint (Sec. 5.1): P(f(z2) | f(z1), change) needs no pose of the object, and gives none.

It holds also for objects that have no front. How sure it is depends on the view it starts from and on the change.
"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.latent.descent import descend
from semantic_slam.latent.direction import NUM_INPUTS, encoded
from semantic_slam.latent.feature_views import FeatureViews
from semantic_slam.latent.smooth_network import SmoothNetwork
from semantic_slam.latent.torch_network import exported, tanh_network
from semantic_slam.viewpoint.model import Viewpoints

Array = NDArray[np.float64]

SMALLEST_LOG_SIGMA, LARGEST_LOG_SIGMA = -5.0, 5.0


@dataclass(frozen=True)
class ChangePrediction:
    """A Gaussian over the second view's feature, diagonal."""

    mean: Array  # (B, F)
    sigma: Array  # (B, F)

    def log_likelihood(self, features: Array) -> Array:
        """(B,) of (B, F) features [nats]."""
        residual = (features - self.mean) / self.sigma
        return np.asarray(
            -(0.5 * residual**2 + np.log(self.sigma)).sum(axis=1) - 0.5 * len(self.mean.T) * np.log(2 * np.pi)
        )


@dataclass(frozen=True)
class ChangeModel:
    """N(f2; mu(f1, change), Sigma(f1, change))."""

    network: SmoothNetwork

    def predict(self, features: Array, change_rad: Array) -> ChangePrediction:
        """From (B, F) features of first views and (B, 2) changes of azimuth and elevation."""
        outputs = self.network.value(np.hstack([features, _encoded_change(change_rad)]))
        step, log_sigma = np.split(outputs, 2, axis=1)
        return ChangePrediction(features + step, np.exp(np.clip(log_sigma, SMALLEST_LOG_SIGMA, LARGEST_LOG_SIGMA)))


@dataclass(frozen=True)
class ChangeSettings:
    """How it is fitted; changes up to ``largest_rad`` in azimuth."""

    hidden: tuple[int, ...] = (128, 128)
    largest_rad: float = float(np.pi)
    steps: int = 4000
    batch_size: int = 512
    learning_rate: float = 3e-3
    seed: int = 0


def fit_change_model(views: FeatureViews, settings: ChangeSettings) -> ChangeModel:
    """From pairs of views of one instance each, drawn anew in every step."""
    torch.set_num_threads(1)
    torch.manual_seed(settings.seed)
    size = views.features.shape[1]
    network = tanh_network((size + NUM_INPUTS, *settings.hidden, 2 * size))
    generator = np.random.default_rng((settings.seed, 17))

    def loss_of(pair: NDArray[np.int_]) -> torch.Tensor:
        first, second = pair
        before, after = views.features[first], views.features[second]
        inputs = torch.from_numpy(np.hstack([before, _encoded_change(changes(views, first, second))])).float()
        step, log_sigma = network(inputs).split(size, dim=1)
        log_sigma = log_sigma.clamp(SMALLEST_LOG_SIGMA, LARGEST_LOG_SIGMA)
        residual = (torch.from_numpy(after - before).float() - step) / log_sigma.exp()
        return (0.5 * residual.square() + log_sigma).sum(dim=1).mean()

    pairs = (
        np.stack(draw_pairs(views, settings.batch_size, settings.largest_rad, generator)) for _ in range(settings.steps)
    )
    groups = [{"params": network.parameters(), "lr": settings.learning_rate}]
    descend(groups, loss_of, pairs, settings.steps, "changes", weight_decay=1e-2)
    return ChangeModel(exported(network))


def draw_pairs(
    views: FeatureViews, count: int, largest_rad: float, generator: np.random.Generator
) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Rows of two views each of one instance, whose azimuths differ by ``largest_rad`` at most; up to ``count``."""
    order = np.argsort(views.instance, kind="stable")
    starts = np.searchsorted(views.instance[order], np.arange(len(views.names) + 1))
    first = generator.integers(len(views), size=4 * count)
    own = views.instance[first]
    second = order[generator.integers(starts[own], starts[own + 1])]
    near = np.abs(changes(views, first, second)[:, 0]) <= largest_rad
    return first[near][:count], second[near][:count]


def changes(views: FeatureViews, first: NDArray[np.int_], second: NDArray[np.int_]) -> Array:
    """(B, 2) change of azimuth, within half a turn, and of elevation from one view to another."""
    azimuth, elevation = views.viewpoints.azimuth_rad, views.viewpoints.elevation_rad
    turn = wrap_angle(azimuth[second] - azimuth[first])
    return np.stack([turn, elevation[second] - elevation[first]], axis=1)


def change_peaks(model: ChangeModel, views: FeatureViews, first: NDArray[np.int_], second: NDArray[np.int_]) -> Array:
    """(B,) error [rad] of the change of azimuth at which the second view's likelihood peaks, all around."""
    turns = np.deg2rad(np.arange(-180.0, 180.0, 3.0))
    truth = changes(views, first, second)
    score = np.empty((len(first), len(turns)))
    for column, turn in enumerate(turns):
        tried = np.column_stack([np.full(len(first), turn), truth[:, 1]])
        score[:, column] = model.predict(views.features[first], tried).log_likelihood(views.features[second])
    return wrap_angle(turns[score.argmax(axis=1)] - truth[:, 0])


def _encoded_change(change_rad: Array) -> Array:
    return encoded(Viewpoints(change_rad[:, 0], change_rad[:, 1], np.zeros(len(change_rad))))
