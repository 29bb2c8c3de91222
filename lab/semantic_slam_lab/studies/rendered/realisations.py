"""One realisation of a wrong track: what each method makes of the same views (Sec. 3.4.4.2)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.classification.class_model import ClassModel
from semantic_slam.classification.classifier import Scores
from semantic_slam.classification.localisation import EvidenceTracks, GeometricTracks, SampledTracks
from semantic_slam.classification.processes import TestNoise
from semantic_slam.classification.track_posterior import GaussianTrack
from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.studies.rendered.methods import METHODS, follow

SAMPLES = 100
"""Samples of the track, for the methods that know of the uncertainty."""
SWEPT = ("ours", "model_based")
EXACT = ("model_based", "simple_bayes")
"""Methods that take the estimated track for the true one."""
ALL = ("ours", "joint", "recursive", *EXACT)
WORDS = {
    "ours": "ours: joint process, tracks weighed by their evidence",
    "joint": "joint process, tracks averaged as in Eq. 3.20",
    "recursive": "the thesis's recursion and average",
    "model_based": METHODS["model_based"].words,
    "simple_bayes": METHODS["simple_bayes"].words,
}


@dataclass(frozen=True)
class Problem:
    """A true track and what was measured along it."""

    name: str
    track_m: Array  # (K, 2)
    scores: Sequence[Scores]  # K


def realisation(
    models: tuple[ClassModel, ...],
    test_noise: TestNoise,
    problem: Problem,
    sigma_m: float,
    methods: Sequence[str],
    key: tuple[int, int],
) -> dict[str, Array]:
    """(K, C) log posteriors by method; errors of the locations are independent and of ``sigma_m`` per coordinate.

    ``key``: seed and number of the realisation. The errors are the same for all methods and settings of the noise, and
    grow with ``sigma_m``.
    """
    errors = keyed_generator("rendered_localization", problem.name, *key).normal(size=problem.track_m.shape)
    estimate = problem.track_m + sigma_m * errors
    posterior = GaussianTrack(estimate, sigma_m**2 * np.eye(estimate.size))
    found = {}
    for name in methods:
        classifier = METHODS["joint" if name == "ours" else name].classifier(models, test_noise)
        if name in EXACT:
            found[name] = follow(classifier, estimate, list(problem.scores))
            continue
        generator = keyed_generator("rendered_localization", "samples", problem.name, name, *key)
        kind: type[SampledTracks] = EvidenceTracks if name == "ours" else GeometricTracks
        tracks = kind(classifier, SAMPLES, generator)
        found[name] = np.stack([tracks.update(scores, posterior) for scores in problem.scores])
    return found
