"""Keyframes whose detections have a label and a vector of the thing that their track names."""

from dataclasses import replace
from zlib import crc32

import numpy as np

from semantic_slam import Configuration, Keyframe

LABELS = ("chair", "cup")
SIZE, SIGMA = 24, 0.3


def with_labels_and_vectors(keyframe: Keyframe) -> Keyframe:
    """Two labels, and looks of each thing's own with noise; the same for the same keyframe."""
    measured, random = keyframe.measurements, np.random.default_rng([keyframe.index, 4])
    numbers = [crc32(name.encode()) for name in measured.track_ids]
    looks = np.array([np.random.default_rng(number).normal(size=SIZE) for number in numbers]).reshape(-1, SIZE)
    vectors = looks + SIGMA * random.normal(size=looks.shape)
    labels = tuple(LABELS[number % 2] for number in numbers)
    return replace(keyframe, measurements=replace(measured, labels=labels, embeddings=vectors))


def by_labels_and_vectors(configuration: Configuration) -> Configuration:
    """The configuration with class models of both."""
    model = replace(configuration.semantic_model, kind="detector_embedding", labels=LABELS)
    return replace(configuration, semantic_model=model)
