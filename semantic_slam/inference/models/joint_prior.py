"""Joint prior of objects with correlated errors: one dense factor of a few objects, a tree of factors of many.

One factor over all objects eliminates them together in every update, at cubic cost. The tree keeps every object's own
Gaussian and the correlations along its edges; of all trees it is nearest to the joint Gaussian in Kullback-Leibler
divergence (Chow and Liu, 1968). It understates the correlation of two objects that are far apart in it. The displaced
twin of an object is a leaf of either: it is as well known as the object, up to how far it may have been moved.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import gtsam
import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.linear_factors import unit_noise
from semantic_slam.inference.states.gaussian import TwinPrior
from semantic_slam.inference.states.keys import object_key

MOST_TOGETHER = 40
"""Most objects in one factor: a keyframe then takes some 20 ms per hypothesis, with twice as many objects ten times
that."""
UNRELATED = 1e-9
"""Nats added to every mutual information, so that the tree spans all objects."""

_jacobian_factor: Any = gtsam.JacobianFactor  # its type stub misses the overloads for one to three keys


def joint_prior_factors(keys: Sequence[int], covariance: Array, means: gtsam.Values) -> list[Any]:
    """Prior factors of n variables of one size at ``means``, in the tangent spaces there. Raises InputError."""
    try:
        whiten = np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))
    except np.linalg.LinAlgError:
        raise InputError(
            "map prior: its joint covariance is not positive definite; save the map anew, or give its objects.json"
        ) from None
    factors = [_together(keys, whiten)] if len(keys) <= MOST_TOGETHER else _tree(keys, covariance)
    return [gtsam.LinearContainerFactor(factor, means) for factor in factors]


def twin_factors(twins: Sequence[TwinPrior], means: gtsam.Values) -> list[Any]:
    """Factors of displaced twins and the objects that they are of, both with the same ``means``."""
    factors = []
    for twin in twins:
        whiten, size = _whitening(twin.covariance), len(twin.covariance)
        keys = object_key(twin.object_id), object_key(twin.of)
        factor = _jacobian_factor(keys[0], whiten, keys[1], -whiten, np.zeros(size), unit_noise(size))
        factors.append(gtsam.LinearContainerFactor(factor, means))
    return factors


def as_factors_say(covariance: Array, count: int) -> Array:
    """(n l, n l) joint covariance of ``count`` objects as :func:`joint_prior_factors` approximates it."""
    if count <= MOST_TOGETHER:
        return covariance
    size, branches = len(covariance) // count, _branches(covariance, count)
    found = np.zeros_like(covariance)
    done: list[int] = []
    for row, parent, gain, spread in branches:
        own = slice(size * row, size * (row + 1))
        if parent >= 0:
            before = slice(size * parent, size * (parent + 1))
            earlier = np.concatenate([np.arange(size * other, size * (other + 1)) for other in done])
            found[own, earlier] = gain @ found[before, earlier]
            found[earlier, own] = found[own, earlier].T
            found[own, own] = gain @ found[before, before] @ gain.T
        found[own, own] += spread
        done.append(row)
    return found


def _together(keys: Sequence[int], whiten: Array) -> Any:
    """One dense factor of all; GTSAM takes an upper triangular root."""
    root = np.linalg.qr(whiten, mode="r")
    root = root * np.sign(np.diag(root))[:, None]
    terms = list(zip(keys, np.split(root, len(keys), axis=1), strict=True))
    zero = np.zeros(len(root))
    return gtsam.JacobianFactor(gtsam.GaussianConditional(terms, len(keys), zero, unit_noise(len(zero))))


def _tree(keys: Sequence[int], covariance: Array) -> list[Any]:
    """One factor for each object, conditioned on its parent in the tree."""
    size = len(covariance) // len(keys)
    zero, noise = np.zeros(size), unit_noise(size)
    factors = []
    for row, parent, gain, spread in _branches(covariance, len(keys)):
        whiten = _whitening(spread)
        if parent < 0:
            factors.append(_jacobian_factor(keys[row], whiten, zero, noise))
        else:
            factors.append(_jacobian_factor(keys[row], whiten, keys[parent], -whiten @ gain, zero, noise))
    return factors


def _branches(covariance: Array, count: int) -> Iterator[tuple[int, int, Array, Array]]:
    """Row, that of its parent or -1, gain (l, l) and covariance (l, l) given the parent, of each object; root first."""
    from scipy.sparse.csgraph import breadth_first_order  # deferred as in _spanning_tree

    size = len(covariance) // count
    blocks = covariance.reshape(count, size, count, size).swapaxes(1, 2)  # (n, n, l, l)
    order, parents = breadth_first_order(_spanning_tree(blocks), 0, directed=False)
    for row in order.tolist():
        parent = int(parents[row])
        if parent < 0:
            yield row, -1, np.zeros((size, size)), blocks[row, row]
            continue
        gain = np.linalg.solve(blocks[parent, parent], blocks[parent, row]).T
        yield row, parent, gain, blocks[row, row] - gain @ blocks[parent, row]


def _spanning_tree(blocks: Array) -> Any:
    """The Chow-Liu tree: the maximum spanning tree by mutual information [nats]."""
    from scipy.sparse.csgraph import minimum_spanning_tree  # deferred: 0.1 s, which only large maps need

    own = np.einsum("iiab->iab", blocks)
    whiten = np.linalg.inv(np.linalg.cholesky(own))
    relative = np.einsum("iab,ijbc,jdc->ijad", whiten, blocks, whiten)
    left = np.eye(own.shape[1]) - relative @ np.swapaxes(relative, -1, -2)
    rows = np.arange(len(own))
    left[rows, rows] = np.eye(own.shape[1])
    nats = np.maximum(-0.5 * np.linalg.slogdet(left)[1], 0.0)
    return minimum_spanning_tree(-(nats + UNRELATED))


def _whitening(covariance: Array) -> Array:
    return np.asarray(np.linalg.inv(np.linalg.cholesky(0.5 * (covariance + covariance.T))))
