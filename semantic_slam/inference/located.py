"""Where the hypotheses of a backend have robot and objects, over the objects that are reported."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.inference.component import Component, object_key, robot_key
from semantic_slam.inference.objects import ObjectRegistry
from semantic_slam.inference.open_component import OpenComponent

Array = NDArray[np.float64]
Index = NDArray[np.int_]


@dataclass(frozen=True)
class Located:
    """Robot and n objects of one hypothesis; d dimensions of a state."""

    present: Index  # (n,) positions of its objects among those reported
    states: Array  # (1 + n, d) the robot first
    covariances: Array  # (1 + n, d, d)
    existence: Array  # (n,)


def located(component: Component, registry: ObjectRegistry) -> Located:
    """With what Gaussians and factors do not say. Raises LostComponentError."""
    if isinstance(component, OpenComponent):
        present = np.searchsorted(registry.ids, component.objects.ids)
        return Located(present, *component.robot_and_objects(), component.objects.existence)
    present = np.array([row for row, n in enumerate(registry.ids) if n in component.object_ids], dtype=int)
    keys = [robot_key(component.keyframe), *(object_key(registry.ids[row]) for row in present)]
    return Located(present, *component.corrected(keys), registry.existence()[present])


def over_all(parts: Sequence[Located], num_objects: int, dimension: int) -> tuple[Array, Array, Array]:
    """(H, 1 + O, d) states, (H, 1 + O, d, d) covariances and (H, O) existence, NaN for what is absent."""
    states = np.full((len(parts), 1 + num_objects, dimension), np.nan)
    covariances = np.full((*states.shape, dimension), np.nan)
    existence = np.full((len(parts), num_objects), np.nan)
    for row, part in enumerate(parts):
        at = np.append(0, 1 + part.present)
        states[row, at], covariances[row, at] = part.states, part.covariances
        existence[row, part.present] = part.existence
    return states, covariances, existence
