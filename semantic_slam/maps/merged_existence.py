"""Existence of the objects of a merged map, as the difference of the two maps has it."""

import numpy as np
from scipy.special import expit, logit

from semantic_slam.geometry.arrays import Array
from semantic_slam.maps.comparison import Comparison
from semantic_slam.maps.differences import gone
from semantic_slam.maps.merged_objects import MergedRows
from semantic_slam.maps.saved_map import have_common_ancestor

SURELY_NOT = 1e-9
"""Least probability of existence, and of not existing, that is taken for known: log odds stay finite."""


def merged_existence(comparison: Comparison, rows: MergedRows) -> Array:
    """(N,) existence probabilities: of the first map's objects, then of those only in the second one."""
    ours, theirs = comparison.old.objects.existence, comparison.new.objects.existence
    count = len(ours)
    found = np.concatenate([_standing(comparison), theirs[rows.kept[count:] - count]])
    is_of_one_source = have_common_ancestor(comparison.old, comparison.new)
    for i, j in (*rows.same, *rows.displaced):
        found[i] = _of_one_source(ours[i], theirs[j]) if is_of_one_source else _of_pair(comparison, i, j)
    return np.asarray(np.clip(found, 0.0, 1.0))


def _standing(comparison: Comparison) -> Array:
    """(O,) probabilities that the first map's objects are in the second one, or there unseen."""
    existence = comparison.old.objects.existence.copy()
    matched = _matched(comparison).sum(axis=1)
    for row, number in enumerate(comparison.ours.rows.tolist()):
        existence[number] = matched[row] + gone(comparison, row)[1]
    return existence


def _of_pair(comparison: Comparison, i: int, j: int) -> float:
    """Probability that the object of a pair exists: it is one object, or the first map's stands, or the second's does.

    Two maps that state an object at one place agree, which the likelihood of the pair has weighed; that either exists
    by itself counts only if they are not one.
    """
    matched = _matched(comparison)
    row, column = comparison.ours.rows.tolist().index(i), comparison.theirs.rows.tolist().index(j)
    pair = float(matched[row, column])
    first = matched[row].sum() + gone(comparison, row)[1]
    seen = matched[:, column].sum()
    last = seen + max(1.0 - seen, 0.0) * comparison.theirs.existence[column]
    apart = max(1.0 - pair, SURELY_NOT)
    neither = (1.0 - (first - pair) / apart) * (1.0 - (last - pair) / apart)
    return 1.0 - apart * float(np.clip(neither, 0.0, 1.0))


def _matched(comparison: Comparison) -> Array:
    """(n, m) probabilities that two objects are one, unmoved or displaced."""
    return comparison.same + comparison.displaced


def _of_one_source(first: float, last: float) -> float:
    """Existence of a pair that both maps may know from one source: each has half of its log odds."""
    known = np.clip([first, last], SURELY_NOT, 1.0 - SURELY_NOT)
    return float(expit(0.5 * logit(known).sum()))
