"""Association histories: the lineage of a hypothesis through the recorded beliefs."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from semantic_slam.inference.belief import HybridBelief

UNKNOWN = -2
"""Marks a detection without ground truth, which is not judged."""
UNMATCHED = -3
"""Marks a true object without a counterpart in the map: no association of the detection is right."""

Ids = NDArray[np.int64]


def associated_objects(belief: HybridBelief) -> Ids:
    """(H, D) object id of every detection under every hypothesis, -1 clutter."""
    associations = np.asarray(belief.associations, dtype=np.int64)
    if not len(belief.object_ids):
        return associations
    return np.asarray(np.where(associations >= 0, belief.object_ids.astype(np.int64)[associations], -1))


def best_index(belief: HybridBelief) -> int:
    """Index of the heaviest hypothesis."""
    return int(np.argmax(belief.log_weights))


def lineage(beliefs: Sequence[HybridBelief]) -> list[int]:
    """Index, at every keyframe, of the ancestor of the final best hypothesis.

    -1 where the lineage is not recorded (a bag that starts late or has a gap).
    """
    if not beliefs:
        return []
    ancestors = [best_index(beliefs[-1])]
    for belief, child in zip(reversed(beliefs[:-1]), reversed(beliefs[1:]), strict=True):
        parent = child.parent_ids[ancestors[-1]] if ancestors[-1] >= 0 else None
        found = [] if parent is None else np.flatnonzero(belief.hypothesis_ids == parent).tolist()
        ancestors.append(found[0] if found else -1)
    return ancestors[::-1]


def histories(beliefs: Sequence[HybridBelief]) -> list[Ids]:
    """(H, D) object id of every detection of each keyframe under the H final hypotheses.

    Revised histories are given as revised. -1: clutter, or a lineage that is not recorded.
    """
    ancestors = np.arange(len(beliefs[-1].hypothesis_ids)) if beliefs else np.zeros(0, dtype=int)
    changed: list[dict[tuple[int, int], int]] = [{} for _ in ancestors]  # (keyframe, detection) -> object
    rows: list[Ids] = []
    for number in range(len(beliefs) - 1, -1, -1):
        belief = beliefs[number]
        found = np.where(ancestors[:, None] >= 0, associated_objects(belief)[ancestors], -1)
        for row, changes in enumerate(changed):
            for detection in range(found.shape[1]):
                found[row, detection] = changes.get((belief.keyframe, detection), found[row, detection])
        rows.append(found)
        ids = np.where(ancestors >= 0, belief.hypothesis_ids[ancestors], 0)
        for changes, own in zip(changed, ids, strict=True):
            for change in np.flatnonzero(belief.revised_ids == own):
                place = int(belief.revised_keyframes[change]), int(belief.revised_detections[change])
                changes.setdefault(place, int(belief.revised_objects[change]))  # later revisions have the last word
        if number:
            place_of = {int(own): at for at, own in enumerate(beliefs[number - 1].hypothesis_ids)}
            known = [place_of.get(int(parent), -1) for parent in belief.parent_ids[ancestors]]
            ancestors = np.where(ancestors >= 0, known, -1).astype(int)
    return rows[::-1]


def best_history(beliefs: Sequence[HybridBelief]) -> list[Ids | None]:
    """(D,) object id of every detection of each keyframe under the final best hypothesis.

    None where the lineage is not recorded.
    """
    return [
        found[best_index(beliefs[-1])] if ancestor >= 0 else None
        for found, ancestor in zip(histories(beliefs), lineage(beliefs), strict=True)
    ]


def step_is_right(belief: HybridBelief, true_objects: Ids) -> NDArray[np.bool_]:
    """(H,) whether a hypothesis gives every detection of this keyframe its true object.

    ``true_objects`` is (D,): object id, -1 clutter, :data:`UNKNOWN` or :data:`UNMATCHED`.
    """
    right = associated_objects(belief) == true_objects
    return np.asarray(np.all(right | (true_objects == UNKNOWN), axis=1))


def true_association_probability(beliefs: Sequence[HybridBelief], true_objects: Sequence[Ids]) -> NDArray[np.float64]:
    """(K,) P(true association history) after every keyframe: the weight of all hypotheses right so far.

    A hypothesis is right when its parent is and its own step is; the classes and modes that it differs in do
    not matter. Parents of the first recorded keyframe count as right.
    """
    probability = np.zeros(len(beliefs))
    right_ids: set[int] = set()
    for k, (belief, truth) in enumerate(zip(beliefs, true_objects, strict=True)):
        grown = np.array([k == 0 or int(parent) in right_ids for parent in belief.parent_ids], dtype=bool)
        right = grown & step_is_right(belief, truth)
        right_ids = {int(value) for value in belief.hypothesis_ids[right]}
        probability[k] = np.exp(belief.log_weights[right]).sum()
    return probability


def first_settled(probability: NDArray[np.float64], threshold: float = 0.99) -> int | None:
    """First index from which ``probability`` stays at or above ``threshold`` to the end; None when it does not."""
    below = np.flatnonzero(probability < threshold)
    first = int(below[-1]) + 1 if len(below) else 0
    return first if first < len(probability) else None
