"""Places of objects that stand apart under different hypotheses, as a mixture of a few Gaussians for each object.

The mean and the covariance over all hypotheses describe an object whose place the hypotheses agree on. Of one that is
in either of two places they name a third one in between; of one whose place some hypotheses know and others hardly do
they tell what neither means. Hypotheses that agree within covariances of about one size share a place.
"""

from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array, Index, squared_norms
from semantic_slam.geometry.moments import position_moments
from semantic_slam.inference.object_table import ObjectTable

LEAST_SPREAD = 0.5
"""Variance between hypotheses, relative to that within them, from which on the places of an object are told apart."""
LEAST_BLUR = 0.5
"""Nats lost by one Gaussian for hypotheses of different variances, from which on their places are told apart."""
AGREE = 1.0
"""Squared distance, in the sum of both mean variances, up to which a hypothesis shares the place of a heavier one."""
ALIKE = 16.0
"""Largest ratio of the mean variances of two hypotheses that share a place."""
MOST_PLACES = 8
"""Places per object; the last one is that of all further hypotheses."""
LEAST_VARIANCE_M2 = 1e-10
"""Added to variances: heights are known exactly in the plane."""


def distinct_places(weights: Array, objects: ObjectTable) -> dict[str, Any]:
    """The belief's fields ``place_*`` of (H,) weighted hypotheses with a table (H, O, ...) of objects.

    Probabilities of places are those given that the object exists; they sum to one for each object.
    """
    rows, probabilities, means, covariances = list[int](), list[float](), list[Array](), list[Array]()
    shares = _shares(weights, objects)
    positions = np.where(shares[..., None] > 0.0, objects.object_poses[..., :3], 0.0)
    inner = np.where(shares[..., None, None] > 0.0, objects.object_covariances[..., :3, :3], 0.0)
    inner = inner + LEAST_VARIANCE_M2 * np.eye(3)
    variances = np.trace(inner, axis1=2, axis2=3) / 2.0  # of x and y in the plane
    differ = (_spread(shares, positions, inner) > LEAST_SPREAD) | (_blur(shares, variances) > LEAST_BLUR)
    for row in np.flatnonzero(differ).tolist():
        groups = _groups(shares[:, row], positions[:, row], variances[:, row])
        if len(groups) < 2:
            continue
        for members in groups:
            own = shares[members, row]
            mean, covariance = position_moments(own / own.sum(), positions[members, row], inner[members, row])
            rows.append(row)
            probabilities.append(float(own.sum()))
            means.append(mean)
            covariances.append(covariance)
    return {
        "place_objects": np.array(rows, dtype=np.uint32),
        "place_probabilities": np.array(probabilities),
        "place_means": np.array(means).reshape(-1, 3),
        "place_covariances": np.array(covariances).reshape(-1, 3, 3),
    }


def _shares(weights: Array, objects: ObjectTable) -> Array:
    """(H, O) probability of each hypothesis given that the object exists; 0 where its place is not known."""
    known = np.isfinite(objects.object_poses).all(axis=-1) & np.isfinite(objects.object_covariances).all(axis=(-1, -2))
    shares = np.where(known, weights[:, None] * np.clip(np.nan_to_num(objects.existence), 0.0, 1.0), 0.0)
    total = shares.sum(axis=0)
    return np.asarray(shares / np.where(total > 0.0, total, 1.0))


def _spread(shares: Array, positions: Array, inner: Array) -> Array:
    """(O,) expected squared Mahalanobis distance of the hypotheses' means from their mean, by the mean covariance."""
    mean = np.einsum("ho,hoi->oi", shares, positions)
    within = np.einsum("ho,hoij->oij", shares, inner) + LEAST_VARIANCE_M2 * np.eye(3)
    off = positions - mean
    between = np.einsum("ho,hoi,hoj->oij", shares, off, off)
    return np.asarray(np.trace(np.linalg.solve(within, between), axis1=1, axis2=2))


def _blur(shares: Array, variances: Array) -> Array:
    """(O,) nats lost by one planar Gaussian about one mean for hypotheses of (H, O) variances.

    The mean excess entropy, which bounds the Kullback-Leibler divergence from the mixture (Runnalls 2007).
    """
    mean = (shares * variances).sum(axis=0)
    return np.asarray(np.log(mean + LEAST_VARIANCE_M2) - (shares * np.log(variances)).sum(axis=0))


def _groups(shares: Array, positions: Array, variances: Array) -> list[Index]:
    """Hypotheses that share a place each, heaviest place's heaviest hypothesis first."""
    left = np.argsort(-shares, kind="stable")
    left = left[shares[left] > 0.0]
    groups: list[Index] = []
    while len(left):
        joins = np.ones(len(left), dtype=bool)
        if len(groups) < MOST_PLACES - 1:
            apart = squared_norms(positions[left] - positions[left[0]])
            joins = apart <= AGREE * (variances[left] + variances[left[0]])
            ratios = variances[left] / variances[left[0]]
            joins &= (ratios <= ALIKE) & (ratios >= 1.0 / ALIKE)
        groups.append(left[joins])
        left = left[~joins]
    return groups
