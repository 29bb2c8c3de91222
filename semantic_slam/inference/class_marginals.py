"""What hypotheses know of the objects' classes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.object_views import class_posterior
from semantic_slam.inference.world.objects import ObjectRegistry


@dataclass(frozen=True)
class ClassMarginals:
    """Of H hypotheses and O objects in the order of the registry."""

    probabilities: Array  # (H, O, C) one-hot where the class is enumerated, the prior where nothing was seen
    mutual_information: Array  # (H, O) nats, NaN where nothing was seen
    in_coverage: NDArray[np.bool_]  # (H, O)
    forgotten_views: NDArray[np.uint32]  # (H, O)


def class_marginals(components: Sequence[Component], registry: ObjectRegistry) -> ClassMarginals:
    """From the classes that are enumerated, or else from the records of the views."""
    shape, row_of = (len(components), len(registry.ids)), registry.row_of
    probabilities = np.repeat(registry.class_prior()[None], len(components), axis=0)
    known = ClassMarginals(
        probabilities, np.full(shape, np.nan), np.ones(shape, dtype=np.bool_), np.zeros(shape, dtype=np.uint32)
    )
    seen = [(h, row_of[n], views) for h, own in enumerate(components) for n, views in own.views.items() if n in row_of]
    if seen:
        h, rows, records = zip(*seen, strict=True)
        known.mutual_information[h, rows] = [views.mutual_information for views in records]
        known.in_coverage[h, rows] = [views.in_coverage for views in records]
        known.forgotten_views[h, rows] = [views.dropped for views in records]
        if probabilities.shape[2]:
            likelihood = np.array([views.log_likelihood for views in records])
            probabilities[h, rows] = class_posterior(registry.log_class_prior()[list(rows)], likelihood)
    named = [(h, row_of[n], cls) for h, own in enumerate(components) for n, cls in own.classes.items() if n in row_of]
    if named:
        h, rows, classes = zip(*named, strict=True)
        probabilities[h, rows], probabilities[h, rows, classes] = 0.0, 1.0
    return known
