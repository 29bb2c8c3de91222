"""What hypotheses say of the objects that a map has elsewhere: whether each was moved since the map was made."""

from collections.abc import Sequence

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.component_marginals import existence_of
from semantic_slam.inference.evidence.displaced import Displacement
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.keys import object_key
from semantic_slam.inference.world.objects import ObjectEntry, ReportedObjects
from semantic_slam.inference.world.problem import Problem

MOST = 8
"""Objects that are weighed together, those farthest from where the map has them; what is nearer is where it was."""
LEAST_SIGMAS = 1.0
"""Standard deviations of the map from which on an object is weighed at all."""


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
    by_history = bool(problem.displaced.elsewhere)
    for row, component in enumerate(components):
        moved[row, places] = _told(problem, component, mapped) if by_history else _moved(problem, component, mapped)
    return {"moved": moved}


def _told(problem: Problem, component: Component, mapped: Sequence[ObjectEntry]) -> Array:
    """(n,) for the objects of the map, by a history that says of each one seen whether it was moved."""
    there = np.array([existence_of(component, entry.object_id) for entry in mapped])
    elsewhere = [existence_of(component, problem.displaced.elsewhere[entry.object_id]) for entry in mapped]
    return np.asarray(elsewhere / (there + elsewhere))


def _moved(problem: Problem, component: Component, mapped: Sequence[ObjectEntry]) -> Array:
    """(n,) for the objects of the map. Raises LostComponentError."""
    landmark, settings = problem.spaces.landmark, problem.closed_world
    size = landmark.tangent_size
    keys = [object_key(entry.object_id) for entry in mapped]
    states = component.states(keys)[:, : landmark.storage_size]
    means = np.array([entry.prior.mean for entry in mapped])
    slopes = landmark.position_slopes(means)
    priors = slopes @ np.array([entry.prior.covariance for entry in mapped]) @ np.swapaxes(slopes, 1, 2)
    offsets = landmark.position(states) - landmark.position(means)
    distances = np.sqrt(np.einsum("ni,nij,nj->n", offsets, np.linalg.inv(priors), offsets))
    moved = np.full(len(mapped), settings.displaced_share)
    far = np.sort(np.argsort(-distances, kind="stable")[:MOST])
    far = far[distances[far] > LEAST_SIGMAS]
    if not len(far):
        return moved
    joint = component.joint_covariance([keys[i] for i in far]).reshape(len(far), size, len(far), size)
    by_state = landmark.position_slopes(states[far])
    covariance = np.einsum("aip,apbq,bjq->aibj", by_state, joint, by_state)
    dimensions = by_state.shape[1]
    moved[far] = Displacement(
        offset=offsets[far],
        covariance=covariance.reshape(len(far) * dimensions, -1),
        prior=priors[far],
        share=settings.displaced_share,
        sigma_m=settings.displaced_sigma_m,
    ).probabilities()
    return moved
