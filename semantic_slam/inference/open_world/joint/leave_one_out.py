"""Density of each detection of a joint assignment given all others, as if it had not been assigned itself.

With P the inverse of the joint covariance of the residuals r, the residual of detection i given all others has the
covariance 1 / P_ii, and lies (P r)_i / P_ii away from its mean (Sundararajan and Keerthi 2001, for Gaussian processes).
"""

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.inference.evidence.outlier_choices import likeliest_outliers
from semantic_slam.inference.models.noise.heavy_tail import HeavyTail
from semantic_slam.inference.open_world.joint.linear_evidence import JointInnovation
from semantic_slam.inference.open_world.joint.log_gaussian import log_gaussian


def log_density_of_each(joint: JointInnovation, tail: HeavyTail | None) -> Array:
    """(n,) log density of each of n detections given the others, ``joint`` of one assignment.

    With a ``tail`` it is a mixture of an inlier and an outlier, given the likeliest choice for the others.
    """
    if tail is None:
        off, covariance = _given_others(joint.residual, joint.covariance, joint.measured)
        return joint.log_normalisers + log_gaussian(off, covariance)
    outlier = likeliest_outliers(tail, joint.residual[None], joint.covariance[None], joint.measured[None])[0]
    added = tail.added * joint.measured
    chosen = np.diag(np.where(outlier[:, None], added, 0.0).ravel())
    off, covariance = _given_others(joint.residual, joint.covariance + chosen, joint.measured)
    width = added[:, :, None] * np.eye(added.shape[1])
    inlier = covariance - np.where(outlier[:, None, None], width, 0.0)
    alternatives = tail.log_rest + log_gaussian(off, inlier), tail.log_share + log_gaussian(off, inlier + width)
    return np.asarray(joint.log_normalisers + np.logaddexp(*alternatives))


def _given_others(residual: Array, covariance: Array, measured: Flags) -> tuple[Array, Array]:
    """(n, c) distances of residuals from their means given the other detections, and (n, c, c) covariances there."""
    count, size = measured.shape
    precision = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
    each = np.arange(count)
    around = np.linalg.inv(precision.reshape(count, size, count, size)[each, :, each])
    return (around @ (precision @ residual).reshape(count, size, 1))[..., 0], np.asarray(around)
