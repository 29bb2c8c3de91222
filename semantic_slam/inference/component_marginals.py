"""Where the hypotheses of a backend have robot and objects, over the objects that are reported."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.inference.world.objects import ReportedObjects


@dataclass(frozen=True, kw_only=True)
class ComponentMarginals:
    """Robot and n objects of one hypothesis, in rows as wide as the wider kind."""

    present: Index  # (n,) positions of its objects among those reported
    states: Array  # (1 + n, s) the robot first
    covariances: Array  # (1 + n, w, w)
    existence: Array  # (n,)


def component_marginals(component: Component, reported: ReportedObjects) -> ComponentMarginals:
    """With what Gaussians and factors do not say. Raises LostComponentError."""
    present = [row for row, n in enumerate(reported.ids) if n in component.object_ids]
    ids = [reported.ids[row] for row in present]
    states, covariances = component.robot_and_objects(ids)
    existence = component.objects.existence[component.objects.rows(np.array(ids, dtype=int))]
    return ComponentMarginals(
        present=np.array(present, dtype=int), states=states, covariances=covariances, existence=existence
    )


def aligned_marginals(
    parts: Sequence[ComponentMarginals], num_objects: int, spaces: Spaces
) -> tuple[Array, Array, Array]:
    """(H, 1 + O, s) states, (H, 1 + O, w, w) covariances and (H, O) existence, NaN for what is absent."""
    shape, width = (len(parts), 1 + num_objects), spaces.layout.width
    states = np.full((*shape, spaces.storage.width), np.nan)
    covariances = np.full((*shape, width, width), np.nan)
    existence = np.full((len(parts), num_objects), np.nan)
    for row, part in enumerate(parts):
        at = np.append(0, 1 + part.present)
        states[row, at], covariances[row, at] = part.states, part.covariances
        existence[row, part.present] = part.existence
    return states, covariances, existence
