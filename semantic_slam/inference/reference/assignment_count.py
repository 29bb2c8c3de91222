"""Number of the assignments of a keyframe's detections to the objects of a known map, weighed as the belief does."""

import numpy as np
from scipy.special import gammaln

from semantic_slam.geometry.arrays import Array


def log_num_assignments(
    num_detections: int, num_certain: int, uncertain: Array, clutter: float, distinct: bool
) -> float:
    """Log of the sum over all assignments of n detections to objects or clutter of their weights in a closed world.

    Each object weighs 1 and each clutter detection ``clutter``, its rate. ``uncertain`` (K,) are the existence
    probabilities of objects that may not exist, which are independent. An integral of the belief's density over all
    measurements of n detections is this number.
    """
    counts = num_certain + np.arange(len(uncertain) + 1)
    with np.errstate(divide="ignore"):
        log_shares, log_clutter = np.log(_shares_of_counts(uncertain)), float(np.log(clutter))
        if not distinct:
            logs = num_detections * np.log(counts + clutter) if num_detections else np.zeros(len(counts))
        else:
            logs = np.array([_log_distinct(num_detections, count, log_clutter) for count in counts.tolist()])
    return float(np.logaddexp.reduce(log_shares + logs))


def _shares_of_counts(existence: Array) -> Array:
    """(K + 1,) probabilities that 0 ... K of K objects exist (Poisson binomial distribution)."""
    shares = np.ones(1)
    for own in existence.tolist():
        shares = np.convolve(shares, [1.0 - own, own])
    return shares


def _log_distinct(n: int, num_objects: int, log_clutter: float) -> float:
    """Log of the sum for distinct objects that surely exist.

    The j detections of objects are chosen in n! / (j! (n - j)!) ways, and their objects in V! / (V - j)! ways.
    """
    j = np.arange(min(n, num_objects) + 1)
    if not np.isfinite(log_clutter):
        return float(gammaln(num_objects + 1.0) - gammaln(num_objects - n + 1.0)) if n <= num_objects else -np.inf
    chosen = gammaln(n + 1.0) - gammaln(j + 1.0) - gammaln(n - j + 1.0)
    objects = gammaln(num_objects + 1.0) - gammaln(num_objects - j + 1.0)
    return float(np.logaddexp.reduce(chosen + objects + (n - j) * log_clutter))
