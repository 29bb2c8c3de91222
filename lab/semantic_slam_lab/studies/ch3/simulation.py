"""Scores of a simulated classifier along a track (Alg. 3.2)."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.classification.classifier import Scores
from semantic_slam.classification.processes import ClassProcesses
from semantic_slam.geometry.arrays import Array


@dataclass(frozen=True)
class SimulatedScores:
    """K views of F components."""

    nominal: Array  # (K, F) drawn from the true class's process
    noised: Array  # (K, F) what a classifier without dropout would say
    clouds: Array  # (K, n, F) what one with dropout says

    def with_dropout(self) -> list[Scores]:
        """For methods that know of model uncertainty."""
        return [Scores.of(cloud) for cloud in self.clouds]

    def without(self) -> list[Scores]:
        """For methods that do not."""
        return [Scores.of(row[None]) for row in self.noised]


def simulate(
    processes: ClassProcesses,
    true_class: int,
    track_m: Array,
    generator: np.random.Generator,
    *,
    sigma_max: float,
    num_samples: int,
) -> SimulatedScores:
    """Nominal scores of the whole track, then at each view a level of model uncertainty and the cloud that it makes.

    The level sigma_u is uniform in 0..``sigma_max`` and is a standard deviation, as Fig. 3.2 has it: of the noised
    score about the nominal one, and of the cloud about the noised one.
    """
    nominal = draw_scores(processes, true_class, track_m, generator)
    sigma = generator.uniform(0.0, sigma_max, len(track_m))
    noised = nominal + sigma[:, None] * generator.standard_normal(nominal.shape)
    spread = generator.standard_normal((len(track_m), num_samples, nominal.shape[1]))
    return SimulatedScores(nominal, noised, noised[:, None] + sigma[:, None, None] * spread)


def draw_scores(processes: ClassProcesses, true_class: int, track_m: Array, generator: np.random.Generator) -> Array:
    """(K, F) scores of one realisation of the class's processes along the track."""
    mean, covariance = processes.posterior(track_m)
    values, vectors = np.linalg.eigh(covariance[true_class])  # (F, K), (F, K, K); may be singular
    roots = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    drawn = generator.standard_normal((*values.shape, 1))
    return np.asarray(mean[true_class] + (roots @ drawn)[..., 0].T)
