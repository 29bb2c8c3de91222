"""Class models and tracks of chapter 3's simulated scenarios, given by hand or drawn at random."""

import json
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np

from semantic_slam.classification.class_model import ClassModel
from semantic_slam.geometry.arrays import Array

TRAINING_RADII_M = (6.0, 9.0, 12.0)
TRAINING_AZIMUTHS = 14
TRACK_RADIUS_M = 9.0
RANDOM_CLASSES, RANDOM_VIEWS = 4, 20


@dataclass(frozen=True)
class Scenario:
    """One object of C classes that gives F = C scores, seen from K places."""

    models: tuple[ClassModel, ...]  # C
    track_m: Array  # (K, 2) camera relative to the object
    true_class: int


def given_scenario(name: str) -> tuple[Scenario, dict[str, Any]]:
    """A scenario of ``scenarios/ch3_gp_models.json``, and its other numbers and lists of numbers."""
    text = (files("semantic_slam_lab.studies") / "scenarios" / "ch3_gp_models.json").read_text(encoding="utf-8")
    row = json.loads(text)[name]
    models = tuple(ClassModel.from_json(model) for model in row.pop("models"))
    return Scenario(models, np.array(row.pop("track")), row.pop("true_class")), row


def random_scenario(generator: np.random.Generator) -> Scenario:
    """Classes whose scores vary smoothly around the object, and a track that wanders around it."""
    models = tuple(_random_model(generator) for _ in range(RANDOM_CLASSES))
    turn = generator.choice([-1.0, 1.0]) * generator.uniform(0.1, 0.3, RANDOM_VIEWS)
    azimuth = generator.uniform(-np.pi, np.pi) + np.cumsum(turn)
    radius = TRACK_RADIUS_M + np.clip(np.cumsum(generator.normal(0.0, 0.4, RANDOM_VIEWS)), -2.5, 2.5)
    return Scenario(models, _around(radius, azimuth), int(generator.integers(RANDOM_CLASSES)))


def _random_model(generator: np.random.Generator) -> ClassModel:
    """Softmax of random harmonics of the azimuth, as a classifier's scores would be."""
    azimuth = np.tile(np.arange(TRAINING_AZIMUTHS) * (2.0 * np.pi / TRAINING_AZIMUTHS), len(TRAINING_RADII_M))
    radius = np.repeat(TRAINING_RADII_M, TRAINING_AZIMUTHS)
    harmonics = np.stack([f(n * azimuth) / n for n in (1, 2) for f in (np.cos, np.sin)], axis=-1)
    logits = generator.normal(0.0, 0.5, RANDOM_CLASSES) + harmonics @ generator.normal(0.0, 0.7, (4, RANDOM_CLASSES))
    scores = np.exp(logits) / np.exp(logits).sum(axis=1, keepdims=True)
    return ClassModel(
        inputs=_around(radius, azimuth),
        scores=scores,
        signal_variance=np.full(RANDOM_CLASSES, 0.1),
        length_squared=np.tile(25.0 * np.eye(2), (RANDOM_CLASSES, 1, 1)),
        noise_sigma=np.full(RANDOM_CLASSES, 0.03),
    )


def _around(radius_m: Array, azimuth_rad: Array) -> Array:
    return np.asarray(radius_m[..., None] * np.stack([np.cos(azimuth_rad), np.sin(azimuth_rad)], axis=-1))
