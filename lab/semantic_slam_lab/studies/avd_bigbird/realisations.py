"""One realisation: the same views with another wrong estimate of where they were taken (Sec. 3.4.5.2)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.classification.baselines import ModelBasedClassifier, SimpleBayesClassifier
from semantic_slam.classification.class_model import ClassModel
from semantic_slam.classification.classifier import Scores, SequentialClassifier, View
from semantic_slam.classification.joint import JointClassifier
from semantic_slam.classification.localisation import EvidenceTracks, GeometricTracks, SampledTracks
from semantic_slam.classification.recursive import RecursiveClassifier
from semantic_slam.classification.track_posterior import GaussianTrack
from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.studies.avd_bigbird.models import class_processes

SIGMA_M = 0.3
SAMPLES = 100
EXACT = ("model_based", "simple_bayes")
"""Methods that take the estimated track for the true one."""
METHODS = ("ours", "joint", "recursive", *EXACT)


@dataclass(frozen=True)
class Problem:
    """What was measured along a true track; candidates' models."""

    models: tuple[ClassModel, ...]
    track_m: Array  # (K, 2) true locations relative to the object
    scores: Sequence[Scores]  # K, of the modelled components
    class_scores: Sequence[Scores]  # K, a component per candidate, () where the network does not know them
    bias_m: Array  # (2,) of every location


def realisation(problem: Problem, methods: Sequence[str], key: tuple[int, int]) -> dict[str, Array]:
    """(K, C) log posteriors by method; realisation 0 has the bias alone, the others an own offset about it.

    One offset for the whole track, as a wrong estimate of the object's location is; ``key``: seed and number.
    """
    drawn = SIGMA_M * keyed_generator("avd_bigbird", "offset", *key).normal(size=2) if key[1] else np.zeros(2)
    estimate = problem.track_m + problem.bias_m + drawn
    shared = np.asarray(np.kron(np.ones((len(estimate),) * 2), np.eye(2)), dtype=np.float64)
    posterior = GaussianTrack(estimate, SIGMA_M**2 * shared)
    found = {}
    for name in methods:
        classifier = _classifier(problem, name)
        scores = problem.class_scores if name == "simple_bayes" else problem.scores
        if name in EXACT:
            pairs = zip(estimate, scores, strict=True)
            found[name] = np.stack([classifier.update(View(place[None], score)) for place, score in pairs])
            continue
        tracks = _tracks(name, classifier, keyed_generator("avd_bigbird", "samples", name, *key))
        found[name] = np.stack([tracks.update(score, posterior) for score in scores])
    return found


def _tracks(name: str, classifier: SequentialClassifier, generator: np.random.Generator) -> SampledTracks:
    if name == "ours":
        return EvidenceTracks(classifier, SAMPLES, generator, move=True)
    return GeometricTracks(classifier, SAMPLES, generator)


def _classifier(problem: Problem, name: str) -> SequentialClassifier:
    log_prior = np.full(len(problem.models), -np.log(len(problem.models)))
    if name == "simple_bayes":
        return SimpleBayesClassifier(log_prior)
    processes = class_processes(problem.models)
    if name == "model_based":
        return ModelBasedClassifier(processes, log_prior)
    return RecursiveClassifier(processes, log_prior) if name == "recursive" else JointClassifier(processes, log_prior)
