"""Where a wrong location makes one class look like another, and tracks fixed by that before any method runs."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from semantic_slam.classification.classifier import normalised
from semantic_slam.classification.processes import ClassProcesses
from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.studies.rendered.models import HALF_WIDTH_M, map_places
from semantic_slam_lab.studies.rendered.tracks import inside, random_walk

BIAS_M = np.array([0.1, 0.0])
CANDIDATES = 4000
LIKELIEST, CLEAR = 0.5, 0.9
"""Least probability of the true class, without a bias, at every view of the hard track and of the others: where classes
look alike anyway, localisation is not what matters."""


@dataclass(frozen=True)
class AliasingMap:
    """Posterior from a single view, the true class's mean prediction, by Model Based; (n, n, C), rows along y."""

    biased: Array
    unbiased: Array

    def at(self, picture: Array, locations_m: Array) -> Array:
        """Values of an (n, n) picture at (..., 2) locations."""
        cells = np.floor((locations_m + HALF_WIDTH_M) / (2.0 * HALF_WIDTH_M) * len(picture)).astype(int)
        return np.asarray(picture[cells[..., 1], cells[..., 0]])


def aliasing_map(processes: ClassProcesses, true_class: int) -> AliasingMap:
    """Classifications over a map of places, with the location wrong by BIAS_M, and with the right one."""
    places, size = map_places()
    scores = processes.marginals(places).mean[:, true_class]
    maps = [_single_view(processes, scores, places + bias).reshape(size, size, -1) for bias in (BIAS_M, 0.0)]
    return AliasingMap(*maps)


def fixed_tracks(aliasing: AliasingMap, true_class: int, generator: np.random.Generator) -> dict[str, Array]:
    """Easy, moderate and hard (K, 2) tracks, the best of many random ones by the map alone.

    Hard: the least mean probability of the true class under the bias. Moderate: right at every view, the wrong places
    as near as possible on average. Easy: right at every view, its nearest wrong place as far as possible.
    """
    walks = np.stack([random_walk(generator) for _ in range(CANDIDATES)])
    walks = walks[inside(walks).all(axis=1)]
    known = aliasing.at(aliasing.unbiased[..., true_class], walks).min(axis=1)  # (N,)
    probability = aliasing.at(aliasing.biased[..., true_class], walks).mean(axis=1)
    right = aliasing.biased.argmax(axis=-1) == true_class
    distance = aliasing.at(distance_transform_edt(right), walks)  # (N, K) cells to the nearest wrong one
    steady = (distance > 0.0).all(axis=1) & (known > CLEAR)
    return {
        "easy": walks[np.where(steady, distance.min(axis=1), -np.inf).argmax()],
        "moderate": walks[np.where(steady, distance.mean(axis=1), np.inf).argmin()],
        "hard": walks[np.where(known > LIKELIEST, probability, np.inf).argmin()],
    }


def _single_view(processes: ClassProcesses, scores: Array, locations_m: Array) -> Array:
    """(N, C) posteriors of (N, F) mean scores believed to be seen from (N, 2) locations."""
    found = processes.marginals(locations_m)
    squared = np.square(scores[:, None] - found.mean) / found.variance
    return np.exp(normalised(-0.5 * (squared + np.log(found.variance)).sum(axis=-1)))
