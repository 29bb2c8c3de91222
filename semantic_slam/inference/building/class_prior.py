"""Prior class probabilities of an object, before any view of it."""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.world.map_prior import ObjectPrior

LEAST_CLASS_SHARE = 0.01
"""Share of the uniform distribution in every prior over classes."""


def class_prior(item: ObjectPrior, class_names: tuple[str, ...]) -> Array:
    """(C,) class probabilities, none of which is zero, as an earlier run may have discarded the truth."""
    uniform = even_classes(len(class_names))
    given = np.array([item.class_probabilities.get(name, 0.0) for name in class_names])
    if given.sum() <= 0.0:
        return uniform
    return np.asarray((1.0 - LEAST_CLASS_SHARE) * given / given.sum() + LEAST_CLASS_SHARE * uniform)


def even_classes(num_classes: int) -> Array:
    """(C,) uniform class probabilities, where nothing is known."""
    return np.full(num_classes, 1.0 / max(num_classes, 1))
