"""Which object of the map stands for which true object."""

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment


def match_objects(
    true_ids: Collection[str],
    prior_ids: Collection[int],
    named_objects: Mapping[str, int],
    pairs: Sequence[tuple[str, int]],
) -> dict[str, int]:
    """Object id of every true object that has a counterpart.

    A true id is the decimal text of an object id where a map prior gave the ids (``prior_ids``). Otherwise an
    object of that name is taken (``named_objects``: track ids given with the detections), and otherwise the
    one-to-one assignment that shares most detections: ``pairs`` holds (true id, object id) of every detection.
    """
    by_number = {str(number): number for number in prior_ids}
    matched = {true: by_number[true] for true in true_ids if true in by_number}
    for true in true_ids:
        if true not in matched and named_objects.get(true) not in (None, *matched.values()):
            matched[true] = named_objects[true]
    free = [pair for pair in pairs if pair[0] in set(true_ids) - set(matched) and pair[1] not in matched.values()]
    return matched | _majority(free)


def _majority(pairs: Iterable[tuple[str, int]]) -> dict[str, int]:
    counts = Counter(pair for pair in pairs if pair[1] >= 0)
    rows = sorted({true for true, _ in counts})
    columns = sorted({found for _, found in counts})
    table = np.array([[counts[true, found] for found in columns] for true in rows]).reshape(len(rows), len(columns))
    chosen = zip(*linear_sum_assignment(-table), strict=True)
    return {rows[row]: columns[column] for row, column in chosen if table[row, column] > 0}
