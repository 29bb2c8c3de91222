"""Validation of incoming measurements, from a bag or from topics: unusable detections are removed."""

from collections import Counter
from dataclasses import replace

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.geometry.small_matrices import LEAST_VARIANCE, are_covariances
from semantic_slam.perception.measurement import SemanticMeasurements

FARTHEST_M = 1e6
"""Largest plausible distance [m]; larger numbers are faults."""
ROUNDING = 1e-5
"""Error of a score in single precision, by which one may lie outside 0..1."""
NO_SCORES = "scores outside 0..1 taken as not told, give a sigmoid of logits, per cent divided by 100"


def usable(measurements: SemanticMeasurements, topic: str, dropped: Counter[str]) -> SemanticMeasurements:
    """Remove unusable detections; ``dropped`` counts each by its first reason."""
    kept = np.ones(len(measurements), dtype=np.bool_)
    for reason, faulty in faults(measurements).items():
        count = int((kept & faulty).sum())
        if count:
            dropped[f"{topic}: {reason}"] += count
            kept &= ~faulty
    return measurements if kept.all() else measurements.take(np.flatnonzero(kept))


def with_scores(
    measurements: SemanticMeasurements, topic: str, dropped: Counter[str], *, of_classes: bool
) -> SemanticMeasurements:
    """Scores of a detection outside 0..1 become NaN, all of them; ``dropped`` counts these detections.

    ``of_classes``: so do its class scores, which are then no features of class models.
    """
    scores = measurements.scores[:, None]
    told = np.concatenate([scores, measurements.class_scores], axis=1) if of_classes else scores
    if not ((told < 0.0) | (told > 1.0)).any():
        return measurements
    kept = ~np.asarray(((told < -ROUNDING) | (told > 1.0 + ROUNDING)).any(axis=1))
    if not kept.all():
        dropped[f"{topic}: {NO_SCORES}"] += int((~kept).sum())
    found = np.clip(np.where(kept[:, None], told, np.nan), 0.0, 1.0)
    changed = replace(measurements, scores=found[:, 0])
    return replace(changed, class_scores=found[:, 1:]) if of_classes else changed


def faults(measurements: SemanticMeasurements) -> dict[str, Flags]:
    """For each reason, (D,) whether it makes a detection unusable."""
    ranges, bearings = measurements.ranges_m, measurements.bearings_rad
    sensor = not (np.abs(measurements.sensor_position) <= FARTHEST_M).all()
    return {
        "sensor position that is not finite": np.full(len(measurements), sensor),
        "bearing that is not finite": ~(np.abs(bearings) <= FARTHEST_M),
        "range that is not above zero": (ranges <= 0.0) | (ranges > FARTHEST_M),
        "covariance of a place that is not positive definite": ~_are_definite(measurements),
        "features that are not finite": ~_all_finite(measurements.features),
        "covariance of features that is not positive": ~_are_positive(measurements.feature_covariances),
        "class probabilities that are none": ~_are_probabilities(measurements.class_probability_samples),
        "class scores that are not finite": np.asarray(np.isinf(measurements.class_scores).any(axis=1)),
        "score that is not finite": np.isinf(measurements.scores),
    }


def _all_finite(rows: Array) -> Flags:
    return np.asarray(np.isfinite(rows).all(axis=tuple(range(1, rows.ndim))))


def _are_probabilities(samples: Array) -> Flags:
    """(D,) whether all (D, T, C) samples are finite and not negative."""
    return np.asarray(((samples >= 0.0) & (samples < np.inf)).all(axis=(1, 2)))


def _are_positive(covariances: Array) -> Flags:
    """(D,) whether (D, F, F) covariances are finite with no negative variance."""
    return _all_finite(covariances) & (np.diagonal(covariances, axis1=1, axis2=2) >= 0.0).all(axis=1)


def _are_definite(measurements: SemanticMeasurements) -> Flags:
    """(D,) whether the covariance of range and bearing is positive definite, or not given."""
    block, alone = measurements.geometric_covariances, np.isnan(measurements.ranges_m)
    variances = np.diagonal(block, axis1=1, axis2=2)
    untold = np.isnan(variances[:, 1])
    bearing_alone = alone & (variances[:, 1] >= LEAST_VARIANCE) & np.isfinite(variances[:, 1])
    return np.asarray(untold | bearing_alone | are_covariances(block))
