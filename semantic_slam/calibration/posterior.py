"""Posterior noise estimates of a run as priors for the next run."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from semantic_slam.calibration.quantities import rounded, value_of
from semantic_slam.configuration import Configuration
from semantic_slam.inference.models.odometry_bias import CLOCK, NAMES

WIDENED = 0.5
"""Lower bound of a bias's new standard deviation, as a share of the prior's: biases vary between drives."""
PROBABILITY, HALF_RANGE = "open_world.detection_probability", "open_world.detection_half_range_m"
CLUTTER = "open_world.clutter_per_frame"
REGION = ("min_range_m", "max_range_m", "field_of_view_rad", "direction_rad")

Noise = Mapping[str, tuple[float, float]]


def refinements(configuration: Configuration, noise: Noise) -> dict[str, dict[str, Any]]:
    """Name -> new parameter values, from the noise estimates of a run under ``configuration``."""
    found = {
        "biases of odometry": _biases(configuration, noise, NAMES[:CLOCK]),
        "clock of odometry": _biases(configuration, noise, NAMES[CLOCK:]),
        "detection probability": _detection_probability(noise),
        "fall-off with range": _half_range(noise),
        "clutter": _clutter(noise),
        "region of the sensor": _region(noise),
    }
    return {name: changes for name, changes in found.items() if changes}


def _biases(configuration: Configuration, noise: Noise, names: Sequence[str]) -> dict[str, Any]:
    """New prior of each bias: its final estimate and uncertainty."""
    changes: dict[str, Any] = {}
    for name in names:
        if name in noise:
            mean, sigma = noise[name]
            spread = name.replace(".", ".sigma_")
            changes |= {name: rounded(mean), spread: rounded(max(sigma, WIDENED * value_of(configuration, spread)))}
    return changes


def _detection_probability(noise: Noise) -> dict[str, Any]:
    """Three values around the mean, with odds a factor of two apart."""
    if PROBABILITY not in noise:
        return {}
    mean = noise[PROBABILITY][0]
    odds = mean / (1.0 - mean) * np.array([0.5, 1.0, 2.0])
    return {"open_world.detection_probabilities": [rounded(float(value)) for value in odds / (1.0 + odds)]}


def _half_range(noise: Noise) -> dict[str, Any]:
    """Three values around the mean, a factor of sqrt(2) apart; none where there may be no fall-off at all."""
    if HALF_RANGE not in noise or not np.isfinite(noise[HALF_RANGE][0]):
        return {}
    values = noise[HALF_RANGE][0] * np.sqrt([0.5, 1.0, 2.0])
    return {"open_world.detection_half_ranges_m": [rounded(float(value)) for value in values]}


def _clutter(noise: Noise) -> dict[str, Any]:
    """Three values around the mean, a factor of three apart."""
    if CLUTTER not in noise:
        return {}
    values = [rounded(noise[CLUTTER][0] * factor) for factor in (1.0 / 3.0, 1.0, 3.0)]
    return {"open_world.clutters_per_frame": list(dict.fromkeys(values))}  # of zero there is one


def _region(noise: Noise) -> dict[str, Any]:
    names = [f"open_world.{name}" for name in REGION]
    if not noise.keys() >= set(names):
        return {}
    return {"open_world.learn_region": False} | {name: rounded(noise[name][0]) for name in names}
