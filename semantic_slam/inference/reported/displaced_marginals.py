"""Probabilities that mapped objects were displaced since the map was made, in each hypothesis.

Given the associations, the posterior over which objects were moved is a closed-form sum over alternatives to what the
hypothesis assumes (see ``evidence/displaced``). Averaged over hypotheses it finds moved objects even where the history
with the right assumption for all objects was pruned.
"""

from collections.abc import Sequence

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.evidence.displaced import Displacement
from semantic_slam.inference.reported.component_marginals import existence_of
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.keys import object_key
from semantic_slam.inference.world.objects import ObjectEntry, ReportedObjects
from semantic_slam.inference.world.problem import Problem

MOST = 8
"""Number of objects that are weighed jointly: those farthest from where the map has them.

Of the others, those that the hypothesis assumes to be moved get 1, and the rest keep the prior.
"""


def displaced_marginals(
    problem: Problem, components: Sequence[Component], reported: ReportedObjects
) -> dict[str, Array]:
    """(H, O) probabilities ``moved``, NaN for objects that are not mapped; {} without a displacement model."""
    apart = problem.unmapped_ids | problem.displaced.on_map.keys()
    mapped = [entry for entry in problem.objects if entry.object_id not in apart]
    share = problem.closed_world.displaced_share
    if share <= 0.0 or problem.association.tracks_objects or not components or not mapped:
        return {}
    moved = np.full((len(components), len(reported.ids)), np.nan)
    places = [reported.row_of[entry.object_id] for entry in mapped]
    for row, component in enumerate(components):
        moved[row, places] = _moved(problem, component, mapped)
    return {"moved": moved}


def _moved(problem: Problem, component: Component, mapped: Sequence[ObjectEntry]) -> Array:
    """(n,) probabilities that the mapped objects were moved, in one component. Raises LostComponentError."""
    landmark, settings = problem.spaces.landmark, problem.closed_world
    taken = _taken(problem, component, mapped)
    ids = [
        problem.displaced.elsewhere[e.object_id] if is_moved else e.object_id
        for e, is_moved in zip(mapped, taken, strict=True)
    ]
    keys = [object_key(number) for number in ids]
    states = component.states(keys)[:, : landmark.storage_size]
    means = np.array([entry.prior.mean for entry in mapped])
    slopes = landmark.position_slopes(means)
    priors = slopes @ np.array([entry.prior.covariance for entry in mapped]) @ np.swapaxes(slopes, 1, 2)
    offsets = landmark.position(states) - landmark.position(means)
    distances = np.sqrt(np.einsum("ni,nij,nj->n", offsets, np.linalg.inv(priors), offsets))
    moved = np.where(taken, 1.0, settings.displaced_share)
    far = _farthest(distances)
    size = landmark.tangent_size
    joint = component.joint_covariance([keys[i] for i in far]).reshape(len(far), size, len(far), size)
    by_state = landmark.position_slopes(states[far])
    covariance = np.einsum("aip,apbq,bjq->aibj", by_state, joint, by_state)
    moved[far] = Displacement(
        offset=offsets[far],
        covariance=covariance.reshape(len(far) * by_state.shape[1], -1),
        prior=priors[far],
        taken=taken[far],
        share=settings.displaced_share,
        sigma_m=settings.displaced_sigma_m,
    ).probabilities()
    return moved


def _taken(problem: Problem, component: Component, mapped: Sequence[ObjectEntry]) -> Flags:
    """(n,) mapped objects that the history of a component assumes to be displaced."""
    elsewhere = problem.displaced.elsewhere
    if not elsewhere:
        return np.zeros(len(mapped), dtype=bool)
    return np.array([existence_of(component, entry.object_id) == 0.0 for entry in mapped], dtype=bool)


def _farthest(distances: Array) -> Index:
    """Rows, ascending, of the objects that are weighed: those of the largest Mahalanobis ``distances`` (n,)."""
    return np.sort(np.argsort(-distances, kind="stable")[:MOST])
