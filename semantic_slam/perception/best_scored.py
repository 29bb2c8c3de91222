"""Limit of the detections of one frame: those with the best scores are used."""

from collections import Counter

import numpy as np

from semantic_slam.geometry.arrays import Array, Index

TOO_MANY = "detection with a lower score than perception.max_detections others of its frame"


def best_scored(rows: Index, scores: Array, most: int, dropped: Counter[str], prefix: str = "") -> Index:
    """Select the ``most`` best-scored of ``rows``, in their order; the others are counted in ``dropped``.

    ``scores`` (D,) of all detections of the frame, NaN counts as 0; of equal scores the first ones are used. ``most``
    0: all.
    """
    if not most or len(rows) <= most:
        return rows
    dropped[prefix + TOO_MANY] += len(rows) - most
    order = np.argsort(-np.nan_to_num(scores[rows], nan=0.0), kind="stable")
    return rows[np.sort(order[:most])]
