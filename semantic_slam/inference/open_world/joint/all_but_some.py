"""Conditioning on all blocks of a joint Gaussian but one or two, for many choices of these, by one inverse.

With P the inverse of the covariance S of all blocks, the inverse of S without the blocks R is P - P_:R P_RR^-1 P_R:
(block inversion), so that no choice of R needs a factorisation of its own.
"""

import numpy as np

from semantic_slam.geometry.arrays import Array, Index


def given_all_but(residual: Array, covariance: Array, cross: Array, without: Index) -> tuple[Array, Array]:
    """Shift (B, c) of the mean and reduction (B, c, c) of the covariance of B blocks, given all others but ``without``.

    ``residual`` (n c,) and ``covariance`` (n c, n c) of n blocks, ``cross`` (B, c, n c) the covariance with these, and
    ``without`` (B, 2) two different blocks, the second of which may be -1: none.
    """
    count, size, width = cross.shape
    precision = np.linalg.inv(covariance)
    places = (size * without[:, :, None] + np.arange(size)).reshape(count, -1)  # (B, 2 c) rows of the blocks left out
    some = np.repeat(without >= 0, size, axis=1)
    pairs, components = np.arange(count)[:, None], np.arange(size)[:, None]
    counts = np.ones((count, width))
    counts[np.nonzero(some)[0], places[some]] = 0.0
    kept = cross * counts[:, None]
    weighed = (kept.reshape(-1, width) @ precision).reshape(count, size, width)
    left = np.where(some[:, None], weighed[pairs[:, None], components, places[:, None]], 0.0)  # (B, c, 2 c)
    own = np.where(some[:, :, None] & some[:, None], precision[places[:, :, None], places[:, None]], 0.0)
    own[:, np.arange(2 * size), np.arange(2 * size)] += ~some
    there = np.where(some, residual[places], 0.0)
    of_residual = np.where(some, (precision @ residual)[places] - (own @ there[..., None])[..., 0], 0.0)
    gain = np.linalg.solve(own, np.swapaxes(left, 1, 2))  # (B, 2 c, c)
    shift = weighed @ residual - (left @ there[..., None])[..., 0]
    shift -= (np.swapaxes(gain, 1, 2) @ of_residual[..., None])[..., 0]
    return shift, np.asarray(weighed @ np.swapaxes(kept, 1, 2) - left @ gain)
