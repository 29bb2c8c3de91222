"""Calibration of the belief's probabilities that two detections show one object."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.evaluation.association import CLUTTER
from semantic_slam.geometry.arrays import Array, Index

BINS = 10


@dataclass(frozen=True)
class PairCalibration:
    """Calibration over all judged pairs of detections; NaN where there are none."""

    right_at_90: float  # share of true pairs among those stated with probability 0.9 or more
    ece: float  # |stated - observed| over ten equal bins, weighted by their pairs
    ece_of_stated: float  # only over pairs that some hypothesis takes for one object


def pair_calibration(weights: Array, objects: Index, reference: Sequence[int]) -> PairCalibration:
    """Calibration of P(i and j are one object), the total weight of the hypotheses that say so.

    ``weights`` (H,), ``objects`` (H, N) object id of every detection, ``reference`` (N,) the true one; negative ids are
    clutter and never form a pair. Detections with equal ids in all of these are counted together.
    """
    alike, sizes = np.unique(np.vstack([objects, np.asarray(reference, dtype=int)]), axis=1, return_counts=True)
    found, true = alike[:-1], alike[-1]
    totals = np.zeros((3, 2, BINS))  # count, sum of stated, of true; of all pairs, of those with P > 0
    high = np.zeros(2)
    for row in range(alike.shape[1]):
        rest = slice(row, None)
        one = (found[:, rest] == found[:, row, None]) & (found[:, rest] > CLUTTER)
        stated = np.clip(weights @ one, 0.0, 1.0)
        same = (true[rest] == true[row]) & (true[rest] > CLUTTER)
        count = sizes[row] * sizes[rest].astype(float)
        count[0] = sizes[row] * (sizes[row] - 1) / 2.0
        bins = np.clip(np.ceil(stated * BINS).astype(int) - 1, 0, BINS - 1)
        for at, chosen in enumerate((np.ones(len(stated), dtype=bool), stated > 0.0)):
            for total, values in zip(totals, (count, count * stated, count * same), strict=True):
                total[at] += np.bincount(bins[chosen], weights=values[chosen], minlength=BINS)
        sure = stated >= 0.9
        high += [float((count * same)[sure].sum()), float(count[sure].sum())]
    return PairCalibration(_share(high[0], high[1]), *(_gap(*totals[:, at]) for at in (0, 1)))


def _gap(count: Array, stated: Array, true: Array) -> float:
    return _share(float(np.abs(stated - true).sum()), float(count.sum()))


def _share(part: float, whole: float) -> float:
    return float(part / whole) if whole else float("nan")
