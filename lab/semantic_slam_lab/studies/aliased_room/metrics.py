"""How well the objects at the end of a run are those of the room: GOSPA, ghosts, missing ones, their classes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from semantic_slam.geometry.arrays import Array

CUTOFF_M = 2.0
MATCH_M = 1.0
"""Half the distance between neighbouring pieces of furniture: an object farther than this from all is none of them."""
LEAST_EXISTENCE = 0.5


@dataclass(frozen=True)
class Gospa:
    """Generalised optimal sub-pattern assignment with p = 2, alpha = 2 (Rahmathullah et al. 2017)."""

    total_m: float  # square root of the sum of the three parts below
    localisation_m2: float  # squared distances of the pairs
    missed_m2: float  # c^2 / 2 for every true object without a pair
    false_m2: float  # c^2 / 2 for every estimated one without a pair


def gospa(estimate: Array, truth: Array, cutoff_m: float = CUTOFF_M) -> Gospa:
    """GOSPA of (N, 2) and (M, 2) positions [m]: least over all one-to-one pairings of points nearer than the cut-off.

    A pair costs its squared distance, a point without one c^2 / 2; a pair farther apart than c never pays.
    """
    rows, columns, squared = _pairing(estimate, truth, cutoff_m)
    located = float(squared[rows, columns].sum())
    missed = 0.5 * cutoff_m**2 * (len(truth) - len(columns))
    false = 0.5 * cutoff_m**2 * (len(estimate) - len(rows))
    return Gospa(float(np.sqrt(located + missed + false)), located, missed, false)


def matched(estimate: Array, truth: Array, limit_m: float = MATCH_M) -> NDArray[np.int_]:
    """(M,) row of the estimated object that stands for each true one, one to one and within the limit; -1: missing."""
    rows, columns, _ = _pairing(estimate, truth, limit_m)
    found = np.full(len(truth), -1)
    found[columns] = rows
    return found


def _pairing(estimate: Array, truth: Array, cutoff_m: float) -> tuple[NDArray[np.int_], NDArray[np.int_], Array]:
    """Rows and columns of the best pairs, and all squared distances."""
    squared = ((estimate[:, None, :2] - truth[None, :, :2]) ** 2).sum(axis=-1)
    rows, columns = linear_sum_assignment(np.minimum(squared, cutoff_m**2))
    near = squared[rows, columns] < cutoff_m**2
    return rows[near], columns[near], squared
