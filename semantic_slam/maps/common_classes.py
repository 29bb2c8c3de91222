"""One list of classes for two maps whose runs named different ones, as those of a detector's labels do."""

from dataclasses import replace

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.maps.class_priors import known_priors
from semantic_slam.maps.saved_map import SavedMap
from semantic_slam.perception.class_names import NONE_OF_THESE


def over_common_classes(one: SavedMap, other: SavedMap) -> tuple[SavedMap, SavedMap]:
    """Both maps over the union of their classes; a map without classes stays so. Raises InputError.

    A class that a map does not name lies within its "none of these", which is divided evenly among what it holds: the
    class has that one's evidence, and a part of its probability. Without "none of these" there is no such part, and
    maps of different classes are refused.
    """
    if not one.class_names or not other.class_names or one.class_names == other.class_names:
        return one, other
    if set(one.class_names) != set(other.class_names) and not all(
        NONE_OF_THESE in known.class_names for known in (one, other)
    ):
        raise InputError(
            "the maps know different classes; merge maps of runs with the same class models, or of a detector's labels"
        )
    names = list(dict.fromkeys((*one.class_names, *other.class_names)))
    if NONE_OF_THESE in names:
        names = [name for name in names if name != NONE_OF_THESE] + [NONE_OF_THESE]
    return _over(one, tuple(names)), _over(other, tuple(names))


def _over(known: SavedMap, names: tuple[str, ...]) -> SavedMap:
    """The map with its distributions over ``names``, which include all of its classes."""
    missing = len(names) - len(known.class_names)
    sources = [known.class_names.index(name if name in known.class_names else NONE_OF_THESE) for name in names]
    shares = np.ones(len(names))
    if missing:
        shares[np.array(sources) == known.class_names.index(NONE_OF_THESE)] /= 1.0 + missing

    def spread(distribution: Array) -> Array:
        return np.asarray(distribution[..., sources] * shares)

    objects, hypotheses = known.objects, known.hypotheses
    return replace(
        known,
        class_names=names,
        objects=replace(
            objects,
            class_probabilities=spread(objects.class_probabilities),
            class_priors=spread(known_priors(objects)),
        ),
        hypotheses=replace(hypotheses, class_probabilities=spread(hypotheses.class_probabilities)),
    )
