"""Where the hypotheses of a backend have robot and objects, over the objects that are reported."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.open_component import OpenComponent
from semantic_slam.inference.states.keys import object_key, robot_key
from semantic_slam.inference.world.objects import ObjectRegistry


@dataclass(frozen=True)
class ComponentMarginals:
    """Robot and n objects of one hypothesis; d dimensions of a state."""

    present: Index  # (n,) positions of its objects among those reported
    states: Array  # (1 + n, d) the robot first
    covariances: Array  # (1 + n, d, d)
    existence: Array  # (n,)


def component_marginals(component: Component, registry: ObjectRegistry) -> ComponentMarginals:
    """With what Gaussians and factors do not say. Raises LostComponentError."""
    if isinstance(component, OpenComponent):
        present = np.searchsorted(registry.ids, component.objects.ids)
        return ComponentMarginals(present, *component.robot_and_objects(), component.objects.existence)
    present = np.array([row for row, n in enumerate(registry.ids) if n in component.object_ids], dtype=int)
    keys = [robot_key(component.keyframe), *(object_key(registry.ids[row]) for row in present)]
    return ComponentMarginals(present, *component.corrected(keys), registry.existence()[present])


def aligned_marginals(
    parts: Sequence[ComponentMarginals], num_objects: int, dimension: int
) -> tuple[Array, Array, Array]:
    """(H, 1 + O, d) states, (H, 1 + O, d, d) covariances and (H, O) existence, NaN for what is absent."""
    states = np.full((len(parts), 1 + num_objects, dimension), np.nan)
    covariances = np.full((*states.shape, dimension), np.nan)
    existence = np.full((len(parts), num_objects), np.nan)
    for row, part in enumerate(parts):
        at = np.append(0, 1 + part.present)
        states[row, at], covariances[row, at] = part.states, part.covariances
        existence[row, part.present] = part.existence
    return states, covariances, existence
