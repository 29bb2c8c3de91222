"""Whether an object exists, as one hypothesis sees it: births, misses, and where a miss counts.

Every object is a Bernoulli with existence r. Detections that belong to no known object come from clutter or from
objects not detected so far, both Poisson with an intensity per square metre.
"""

import numpy as np

from semantic_slam.geometry.arrays import Array

LEAST_PROBABILITY = 1e-300


def birth(born: Array, clutter: Array | float) -> tuple[Array, Array]:
    """Intensity of a first detection [1/m^2], and existence of what it is a detection of.

    ``born`` intensities [1/m^2] of first detections of objects where the detection lies, ``clutter`` intensity of false
    alarms [1/m^2].
    """
    total = born + clutter
    return total, np.where(total > 0.0, born / np.where(total > 0.0, total, 1.0), 0.0)


def log_miss(existence: Array, detected: Array) -> Array:
    """Log of 1 - r p_d, the probability that an object is not detected, p_d that of its detection if it exists.

    What cannot be has a log probability far below all others.
    """
    return np.log(_missed(existence, detected))


def existence_after_miss(existence: Array, detected: Array) -> Array:
    """Existence of an object that was not detected, r (1 - p_d) / (1 - r p_d)."""
    return existence * (1.0 - detected) / _missed(existence, detected)


def _missed(existence: Array, detected: Array) -> Array:
    return np.maximum(1.0 - existence * detected, LEAST_PROBABILITY)
