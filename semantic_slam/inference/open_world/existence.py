"""Existence of objects within one hypothesis: births, missed detections, and what each says.

Every object is a Bernoulli component with existence probability r. Detections that belong to no known object come from
clutter or from objects not detected so far; both are Poisson, with intensities per square metre.
"""

import numpy as np

from semantic_slam.geometry.arrays import Array

LEAST_PROBABILITY = 1e-300
LEAST_DETECTION_SHARE = 0.02
"""Least share of the detection probability for detected objects that seem to lie outside the region."""


def birth(born: Array, clutter: Array | float) -> tuple[Array, Array]:
    """Intensity of detections that belong to no known object [1/m^2], and the existence of the object that one starts.

    ``born``: intensities [1/m^2] of first detections of objects at the detection. ``clutter``: intensity of false
    alarms [1/m^2].
    """
    total = born + clutter
    return total, np.where(total > 0.0, born / np.where(total > 0.0, total, 1.0), 0.0)


def log_miss(existence: Array, detected: Array) -> Array:
    """Log of 1 - r p_d, the probability of a missed detection; p_d is the detection probability if the object exists.

    It is floored at ``LEAST_PROBABILITY``, so that an impossible miss has a finite log probability far below all
    others.
    """
    return np.log(_missed(existence, detected))


def existence_after_miss(existence: Array, detected: Array) -> Array:
    """Existence probability after a missed detection, r (1 - p_d) / (1 - r p_d)."""
    return existence * (1.0 - detected) / _missed(existence, detected)


def _missed(existence: Array, detected: Array) -> Array:
    return np.maximum(1.0 - existence * detected, LEAST_PROBABILITY)
