"""Choice of the hypotheses that report an alternative, so that their summed weight is its probability."""

from zlib import crc32

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.alternatives.differences import Change
from semantic_slam.inference.alternatives.shares import LEAST_SHARE, Shares


def balanced(told: Flags, shares: Shares, weights: Array) -> Flags:
    """(R, H) which hypotheses report each alternative, changed from ``told`` only as far as its probability demands.

    The heaviest hypothesis always reports its own history. The order in which the (H,) hypotheses of these ``weights``
    are considered is drawn for each alternative, so that two alternatives are reported together as often as independent
    ones would be.
    """
    may = shares.values >= LEAST_SHARE
    may[:, int(np.argmax(weights))] = False
    told = told & may
    missing = shares.values @ weights - told @ weights
    rows, order = np.arange(len(told)), _orders(shares.changes, len(weights))
    for columns in order.T:
        weight, tells = weights[columns], told[rows, columns]
        fewer = tells & (missing < -0.5 * weight)
        more = ~tells & may[rows, columns] & (missing > 0.5 * weight)
        told[rows, columns] = (tells & ~fewer) | more
        missing += np.where(fewer, weight, 0.0) - np.where(more, weight, 0.0)
    return told


def _orders(changes: list[tuple[Change, ...]], count: int) -> Index:
    """(R, H) orders of the hypotheses, drawn pseudo-randomly by a hash of each alternative's changes."""
    seeds = np.array([crc32(np.array(own, dtype=np.int64).tobytes()) for own in changes], dtype=np.uint64)
    drawn = seeds[:, None] * np.uint64(0x9E3779B97F4A7C15) + np.arange(1, count + 1, dtype=np.uint64)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):  # Steele et al. 2014, SplitMix
        drawn = np.bitwise_xor(drawn, np.right_shift(drawn, np.uint64(shift))) * np.uint64(factor)
    return np.argsort(drawn, axis=1, kind="stable")
