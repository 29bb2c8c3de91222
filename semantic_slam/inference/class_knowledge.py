"""What one hypothesis knows of the objects' classes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.inference.component import Component
from semantic_slam.inference.object_views import class_posterior
from semantic_slam.inference.objects import ObjectRegistry

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ClassKnowledge:
    """Of O objects in the order of the registry."""

    probabilities: Array  # (O, C) one-hot where the class is enumerated, the prior where nothing was seen
    mutual_information: Array  # (O,) nats, NaN where nothing was seen
    in_coverage: NDArray[np.bool_]  # (O,)
    forgotten_views: NDArray[np.uint32]  # (O,)


def class_knowledge(component: Component, registry: ObjectRegistry) -> ClassKnowledge:
    """From the classes that are enumerated, or else from the records of the views."""
    probabilities = registry.class_prior()
    information = np.full(len(registry.ids), np.nan)
    inside = np.ones(len(registry.ids), dtype=np.bool_)
    forgotten = np.zeros(len(registry.ids), dtype=np.uint32)
    seen = [(registry.row_of[n], views) for n, views in component.views.items() if n in registry.row_of]
    if seen and probabilities.shape[1]:
        rows = [row for row, _ in seen]
        likelihood = np.array([views.log_likelihood for _, views in seen])
        probabilities[rows] = class_posterior(registry.log_class_prior()[rows], likelihood)
    for row, views in seen:
        information[row], inside[row] = views.mutual_information, views.in_coverage
        forgotten[row] = views.dropped
    enumerated = [(registry.row_of[n], cls) for n, cls in component.classes.items() if n in registry.row_of]
    if enumerated:
        rows, classes = np.array(enumerated).T
        probabilities[rows], probabilities[rows, classes] = 0.0, 1.0
    return ClassKnowledge(probabilities, information, inside, forgotten)
