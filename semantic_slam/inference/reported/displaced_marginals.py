"""What hypotheses say of the objects that a map has elsewhere: whether each was moved since the map was made.

Given what detections are of, which objects were moved is a sum in closed form, about the one way in which a hypothesis
takes them. Summed over hypotheses it names what was moved, also where the right way of taking all objects was given up.
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
"""Objects that are weighed together, those farthest from where the map has them; of the others nothing is known."""


def displaced_marginals(
    problem: Problem, components: Sequence[Component], reported: ReportedObjects
) -> dict[str, Array]:
    """(H, O) ``moved``, NaN for what no map has; nothing where the map is taken at its word."""
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
    """(n,) for the objects of the map. Raises LostComponentError."""
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
    """(n,) which objects of the map the history of a component has elsewhere."""
    elsewhere = problem.displaced.elsewhere
    if not elsewhere:
        return np.zeros(len(mapped), dtype=bool)
    return np.array([existence_of(component, entry.object_id) == 0.0 for entry in mapped], dtype=bool)


def _farthest(distances: Array) -> Index:
    """Which of (n,) objects are weighed, by how many standard deviations they are off; ascending."""
    return np.sort(np.argsort(-distances, kind="stable")[:MOST])
