"""Log odds between classes in a belief, in nats, also where probabilities have saturated at 0 and 1."""

from collections.abc import Sequence

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.log_space import log_sum_exp
from semantic_slam.inference.belief import HybridBelief


def log_class_probabilities(belief: HybridBelief, object_id: int) -> Array:
    """(C,) log P(c | o) over all hypotheses; -inf for a class of which no hypothesis is left, NaN without the object.

    The hypotheses' log weights are summed as they are: 1 - P is not known to better than 1e-16.
    """
    rows = np.flatnonzero(belief.object_ids == object_id)
    if not len(rows):
        return np.full(len(belief.class_names), np.nan)
    with np.errstate(divide="ignore"):
        of_hypotheses = np.log(belief.hypothesis_class_probabilities[:, rows[0]])
    return np.asarray(log_sum_exp(belief.log_weights[:, None] + of_hypotheses, axis=0))


def top_two(beliefs: Sequence[HybridBelief], object_id: int) -> tuple[str, str] | None:
    """The two likeliest classes of an object at the last keyframe that still gives two of them any weight."""
    for belief in reversed(beliefs):
        logs = log_class_probabilities(belief, object_id)
        first, second = np.argsort(-logs, kind="stable")[:2] if len(logs) > 1 else (0, 0)
        if first != second and np.isfinite(logs[[first, second]]).all():
            return belief.class_names[first], belief.class_names[second]
    return None


def log_odds(beliefs: Sequence[HybridBelief], object_id: int, pair: tuple[str, str]) -> Array:
    """(K,) log P(first) - log P(second) [nats]; infinite once one is pruned, NaN where a class is not modelled."""
    values = np.full(len(beliefs), np.nan)
    for index, belief in enumerate(beliefs):
        if set(pair) <= set(belief.class_names):
            logs = log_class_probabilities(belief, object_id)
            first, second = (logs[belief.class_names.index(name)] for name in pair)
            if np.isfinite(first) or np.isfinite(second):
                values[index] = first - second
    return values
