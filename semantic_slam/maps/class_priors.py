"""Class priors of mapped objects, and the class evidence of each object separated from its prior.

A run's class prior of an object depends on the other objects it has mapped. Two runs through one room share that
knowledge, so it must not be counted twice when their maps are combined.
"""

from collections.abc import Sequence

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.reported.component_marginals import held_as
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.world.objects import ReportedObjects
from semantic_slam.maps.saved_map import MapObjects

LEAST_CLASS = 1e-6
"""Lower bound of class probabilities, so that no class is ruled out permanently."""


def class_priors_of(
    components: Sequence[Component], weights: Array, ids: Index, reported: ReportedObjects, class_shares: Array
) -> Array:
    """(O, C) class priors averaged over H hypotheses by (H,) ``weights``; ``class_shares`` where an object is absent.

    ``class_shares`` (C,) is the class prior of new objects before the run. What an initial map says of an object is
    not part of its prior: it counts as evidence from an earlier run.
    """
    priors = [[_prior_of(own, held_as(own, int(n), reported), class_shares) for n in ids] for own in components]
    stacked = np.array(priors).reshape(len(components), len(ids), len(class_shares))
    return np.asarray(np.tensordot(weights / weights.sum(), stacked, axes=1))


def class_evidence(objects: MapObjects) -> Array:
    """(O, C) class likelihoods of each object's own observations, normalised per object (probability / prior)."""
    if not objects.class_probabilities.shape[1]:
        return objects.class_probabilities
    evidence = (objects.class_probabilities + LEAST_CLASS) / (known_priors(objects) + LEAST_CLASS)
    return np.asarray(evidence / evidence.sum(axis=1, keepdims=True))


def known_priors(objects: MapObjects) -> Array:
    """(O, C) class priors, uniform where the map has none."""
    count = objects.class_priors.shape[1]
    return np.where(np.isnan(objects.class_priors), 1.0 / max(count, 1), objects.class_priors)


def _prior_of(component: Component, number: int, class_shares: Array) -> Array:
    """(C,) class prior as updated by the other mapped objects when this object was added."""
    record = component.views.get(number)
    if record is None or record.log_ratios is None:
        return class_shares
    changed = class_shares * np.exp(record.log_ratios)
    return np.asarray(changed / changed.sum())
