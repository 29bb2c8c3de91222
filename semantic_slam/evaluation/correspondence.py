"""Which object of the map stands for which true object."""

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from semantic_slam.configuration.configuration import PLANAR
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.world.identities import objects_by_identity
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior


def match_objects(
    true_ids: Collection[str], told: Mapping[str, int], pairs: Sequence[tuple[str, int]]
) -> dict[str, int]:
    """Object id of every true object that has a counterpart.

    ``told`` holds the objects that are known by true id. The others are matched one to one so that they share most
    detections: ``pairs`` holds (true id, object id) of every detection.
    """
    unmatched, matched = set(true_ids), dict[str, int]()
    for true, number in told.items():
        if true in unmatched and number not in matched.values():
            matched[true] = number
            unmatched.remove(true)
    free = [pair for pair in pairs if pair[0] in unmatched and pair[1] not in matched.values()]
    return matched | _majority(free)


def told_by_map(prior: MapPrior, true_places: Mapping[str, Array]) -> dict[str, int]:
    """Object ids of true ids that the names and numbers of a map tell; ``true_places`` [m] by true id, (3,) in map.

    A run numbers the objects of its map as it meets them, and a tracker its tracks: such a number may be the true id of
    another object. So where an object is named with a number, it counts only if no other true object is nearer to the
    object's place on the map; and where its true place is not known, only on a map that no run is known to have saved.
    """
    objects = {item.object_id: item for item in prior.objects}
    meant = objects_by_identity({number: item.name for number, item in objects.items()})
    axes = 2 if prior.state_space == PLANAR else 3
    is_saved = bool(prior.map_id or prior.ancestors)

    def counts(true: str, item: ObjectPrior) -> bool:
        if not item.name.isdecimal():
            return True
        return _is_nearest(true, item.pose[:axes], true_places) if true in true_places else not is_saved

    return {true: number for true, number in meant.items() if counts(true, objects[number])}


def _is_nearest(true: str, place: Array, true_places: Mapping[str, Array]) -> bool:
    """Whether no other true object is nearer to a place, (2,) or (3,) in map [m]."""
    distances = {own: float(np.linalg.norm(at[: len(place)] - place)) for own, at in true_places.items()}
    return distances[true] <= min(distances.values())


def _majority(pairs: Iterable[tuple[str, int]]) -> dict[str, int]:
    counts = Counter(pair for pair in pairs if pair[1] >= 0)
    rows = sorted({true for true, _ in counts})
    columns = sorted({found for _, found in counts})
    table = np.array([[counts[true, found] for found in columns] for true in rows]).reshape(len(rows), len(columns))
    chosen = zip(*linear_sum_assignment(-table), strict=True)
    return {rows[row]: columns[column] for row, column in chosen if table[row, column] > 0}
