"""What told of the classes of a map's objects before the objects themselves did, and what these told besides.

Of which class an object is, a run takes from the map that it started from, or from what else it has mapped: two runs
that know the same must not count as two witnesses of it.
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


def class_priors_of(components: Sequence[Component], weights: Array, ids: Index, reported: ReportedObjects) -> Array:
    """(O, C) mean over H hypotheses, whose (H, O) ``weights`` say how much each has an object; 0: reported alone."""
    told = np.zeros((len(components), len(ids), reported.class_prior.shape[1]))
    for row, number in enumerate(ids.tolist()):
        prior = reported.class_prior[reported.row_of[number]]
        told[:, row] = [_prior_of(own, held_as(own, number, reported), prior) for own in components]
    shares = weights + LEAST_CLASS
    return np.asarray(np.einsum("ho,hoc->oc", shares / shares.sum(axis=0), told))


def class_evidence(objects: MapObjects) -> Array:
    """(O, C) proportional to the likelihood of what was seen of each object, adding up to one for each."""
    if not objects.class_probabilities.shape[1]:
        return objects.class_probabilities
    told = (objects.class_probabilities + LEAST_CLASS) / (known_priors(objects) + LEAST_CLASS)
    return np.asarray(told / told.sum(axis=1, keepdims=True))


def known_priors(objects: MapObjects) -> Array:
    """(O, C) class priors, even ones where a map does not tell them."""
    count = objects.class_priors.shape[1]
    return np.where(np.isnan(objects.class_priors), 1.0 / max(count, 1), objects.class_priors)


def _prior_of(component: Component, number: int, prior: Array) -> Array:
    """(C,) that of a run's new objects, or the map's, as what else was mapped changed it when the object was added."""
    record = component.views.get(number)
    if record is None or record.log_ratios is None:
        return prior
    changed = prior * np.exp(record.log_ratios)
    return np.asarray(changed / changed.sum())
