"""One draw of five objects: head, class models, and what every method makes of the tracks around them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.classification.baselines import ModelBasedClassifier, SimpleBayesClassifier
from semantic_slam.classification.classifier import Scores, SequentialClassifier, View
from semantic_slam.classification.joint import JointClassifier
from semantic_slam.classification.localisation import EvidenceTracks
from semantic_slam.classification.processes import ClassProcesses
from semantic_slam.classification.recursive import RecursiveClassifier
from semantic_slam.classification.track_posterior import GaussianTrack
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.studies.ch3.metrics import true_class_first
from semantic_slam_lab.studies.real_turntables.class_models import INPUT_MAP, fit_model
from semantic_slam_lab.studies.real_turntables.lookalikes import NUM_CLASSES, Draw
from semantic_slam_lab.studies.real_turntables.measurement import Measurement, trained_measurement
from semantic_slam_lab.studies.real_turntables.tracks import Track

LOG_PRIOR = np.full(NUM_CLASSES, -np.log(NUM_CLASSES))
SIGMAS_M = {"model": 0.0, "localisation_10cm": 0.1, "localisation_20cm": 0.2}
"""Uncertainty -> standard deviation of the errors of every place of a track, per coordinate, at a range of 1 m."""
SAMPLES = 50
"""Number of samples of a track that is uncertain."""
METHODS = ("ours", "recursive", "model_based", "simple_bayes")


@dataclass(frozen=True)
class DrawData:
    """What a draw is given; features are the trunk's, pooled."""

    draw: Draw
    training: Sequence[tuple[Array, Array]]  # of each class: (M, 2) places and (M, K) features, plain and in rooms
    front: tuple[Array, Index]  # (N, K) features of front views among them, and their labels
    tracks: Sequence[tuple[Track, Array]]  # tracks and their (V, K) features
    pair_views: Sequence[tuple[int, Array, Array]]  # of the two that look alike: class, (V,) azimuths, (V, K) features


@dataclass(frozen=True)
class DrawOutcome:
    """Log posteriors, the true class first, and how sure single views are of which of the two it is."""

    posteriors: Mapping[str, Mapping[str, Array]]  # uncertainty -> method -> (tracks, K, C)
    pair_azimuth_rad: Array  # (V,)
    pair_entropy: Array  # (V,) nats, of the two classes given one view


def outcome_of(data: DrawData, seed: int) -> DrawOutcome:
    """Train, fit and classify; nothing but the draw's data and the seed matters."""
    head = trained_measurement(*data.front, NUM_CLASSES, seed + data.draw.number)
    models = [
        fit_model(places, _means(head, features, ("train", seed, data.draw.number, index)))
        for index, (places, features) in enumerate(data.training)
    ]
    processes = ClassProcesses(models, test_noise="sigma_n", input_map=INPUT_MAP)
    posteriors: dict[str, dict[str, list[Array]]] = {name: {method: [] for method in METHODS} for name in SIGMAS_M}
    for number, (track, features) in enumerate(data.tracks):
        key = (seed, data.draw.number, number)
        scores = [Scores.of(head.samples(row, ("track", *key, step))) for step, row in enumerate(features)]
        for name, sigma_m in SIGMAS_M.items():
            for method in METHODS:
                followed = _followed(method, processes, track, scores, sigma_m, key)
                posteriors[name][method].append(true_class_first(followed, track.true_class))
    stacked = {name: {method: np.stack(logs) for method, logs in own.items()} for name, own in posteriors.items()}
    return DrawOutcome(stacked, *_of_pair(head, processes, data, seed))


def _means(head: Measurement, features: Array, key: tuple[str | int, ...]) -> Array:
    return np.stack([head.samples(row, (*key, index)).mean(axis=0) for index, row in enumerate(features)])


def _followed(
    method: str, processes: ClassProcesses, track: Track, scores: list[Scores], sigma_m: float, key: tuple[int, ...]
) -> Array:
    """(K, C) log posteriors; the errors of the places are the same for all methods."""
    classifier = _classifier(method, processes)
    errors = keyed_generator("real_turntables", "errors", *key).normal(size=track.places_m.shape)
    estimate = track.places_m + sigma_m * errors
    if sigma_m > 0.0 and method == "ours":
        posterior = GaussianTrack(estimate, sigma_m**2 * np.eye(estimate.size))
        generator = keyed_generator("real_turntables", "samples", *key, f"{sigma_m:g}")
        sampled = EvidenceTracks(classifier, SAMPLES, generator)
        return np.stack([sampled.update(score, posterior) for score in scores])
    return np.stack([classifier.update(View(place[None], own)) for place, own in zip(estimate, scores, strict=True)])


def _classifier(method: str, processes: ClassProcesses) -> SequentialClassifier:
    if method == "simple_bayes":
        return SimpleBayesClassifier(LOG_PRIOR)
    if method == "recursive":
        return RecursiveClassifier(processes, LOG_PRIOR)
    return (JointClassifier if method == "ours" else ModelBasedClassifier)(processes, LOG_PRIOR)


def _of_pair(head: Measurement, processes: ClassProcesses, data: DrawData, seed: int) -> tuple[Array, Array]:
    """Azimuths of single views of the two that look alike, and the entropy of which of them it is."""
    azimuths, entropies = [], []
    for index, azimuth, features in data.pair_views:
        for number, (angle, row) in enumerate(zip(azimuth, features, strict=True)):
            scores = Scores.of(head.samples(row, ("pair", seed, data.draw.number, index, number)))
            place = np.array([[np.cos(angle), np.sin(angle)]])
            logs = JointClassifier(processes, LOG_PRIOR).update(View(place, scores))[:2]
            probability = np.exp(logs - np.logaddexp(*logs))
            azimuths.append(angle)
            entropies.append(float(-(probability * np.log(np.maximum(probability, 1e-300))).sum()))
    return np.array(azimuths), np.array(entropies)
