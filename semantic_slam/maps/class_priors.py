"""What a run took the classes of a map's objects to be before it looked at them, and what they told besides.

Of which class an object is, a run takes from what else it has mapped, too: two runs through one room know the same of
it, and must not count as two witnesses.
"""

from collections.abc import Sequence

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.reported.component_marginals import held_as
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.world.objects import ReportedObjects
from semantic_slam.maps.saved_map import MapObjects

LEAST_CLASS = 1e-6
"""Probability of a class that nothing rules out for good."""


def class_priors_of(
    components: Sequence[Component], weights: Array, ids: Index, reported: ReportedObjects, class_shares: Array
) -> Array:
    """(O, C) means over H hypotheses of (H,) ``weights``, as class probabilities are; of what they lack, the shares.

    ``class_shares`` (C,) are those of new objects before the run. What a map at the start says of an object is no part
    of its prior, but evidence that somebody had.
    """
    told = [[_prior_of(own, held_as(own, int(n), reported), class_shares) for n in ids] for own in components]
    stacked = np.array(told).reshape(len(components), len(ids), len(class_shares))
    return np.asarray(np.tensordot(weights / weights.sum(), stacked, axes=1))


def class_evidence(objects: MapObjects) -> Array:
    """(O, C) proportional to the likelihood of what is known of each object by itself, adding up to one for each."""
    if not objects.class_probabilities.shape[1]:
        return objects.class_probabilities
    told = (objects.class_probabilities + LEAST_CLASS) / (known_priors(objects) + LEAST_CLASS)
    return np.asarray(told / told.sum(axis=1, keepdims=True))


def known_priors(objects: MapObjects) -> Array:
    """(O, C) class priors, even ones where a map does not tell them."""
    count = objects.class_priors.shape[1]
    return np.where(np.isnan(objects.class_priors), 1.0 / max(count, 1), objects.class_priors)


def _prior_of(component: Component, number: int, class_shares: Array) -> Array:
    """(C,) shares of classes as what else was mapped had changed them when the object was added."""
    record = component.views.get(number)
    if record is None or record.log_ratios is None:
        return class_shares
    changed = class_shares * np.exp(record.log_ratios)
    return np.asarray(changed / changed.sum())
