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
    known = component.classes.keys() | component.views.keys()
    for row, number in enumerate(registry.ids if known else ()):
        views = component.views.get(number)
        if number in component.classes:
            probabilities[row] = 0.0
            probabilities[row, component.classes[number]] = 1.0
        elif views is not None and probabilities.shape[1]:
            probabilities[row] = class_posterior(registry.log_class_prior_of([number])[0], views.log_likelihood)
        if views is not None:
            information[row], inside[row] = views.mutual_information, views.in_coverage
            forgotten[row] = views.dropped
    return ClassKnowledge(probabilities, information, inside, forgotten)
