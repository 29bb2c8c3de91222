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
from semantic_slam.inference.world.objects import ReportedObjects
from semantic_slam.inference.world.problem import Problem

MOST = 8
"""Number of objects that are weighed jointly: those farthest from where the map has them, given the others.

Of the others, those that the hypothesis assumes to be moved get 1, and the rest keep the prior.
"""


def displaced_marginals(
    problem: Problem, components: Sequence[Component], reported: ReportedObjects
) -> dict[str, Array]:
    """(H, O) probabilities ``moved``, NaN for objects that are not mapped; {} without a displacement model."""
    share = problem.closed_world.displaced_share
    if share <= 0.0 or problem.association.tracks_objects or not components or not problem.mapped:
        return {}
    moved = np.full((len(components), len(reported.ids)), np.nan)
    places = [reported.row_of[entry.object_id] for entry in problem.mapped]
    for row, component in enumerate(components):
        moved[row, places] = _moved(problem, component)
    return {"moved": moved}


def _moved(problem: Problem, component: Component) -> Array:
    """(n,) probabilities that the mapped objects were moved, in one component. Raises LostComponentError."""
    landmark, settings, known = problem.spaces.landmark, problem.closed_world, problem.places_on_map
    taken = _taken(problem, component)
    elsewhere = problem.displaced.elsewhere
    keys = [object_key(elsewhere[n] if is_moved else n) for n, is_moved in zip(known.ids, taken, strict=True)]
    states = component.states(keys)[:, : landmark.storage_size]
    offsets = landmark.position(states) - known.means
    weighed = _farthest(known.distances(offsets))
    rows = known.context(weighed)
    size = landmark.tangent_size
    joint = component.joint_covariance([keys[i] for i in rows]).reshape(len(rows), size, len(rows), size)
    by_state = landmark.position_slopes(states[rows])
    covariance = np.einsum("aip,apbq,bjq->aibj", by_state, joint, by_state)
    wide = np.repeat(taken[rows], by_state.shape[1]) * settings.displaced_sigma_m**2
    moved = np.where(taken, 1.0, settings.displaced_share)
    moved[weighed] = Displacement(
        offset=offsets[rows],
        covariance=covariance.reshape(len(wide), -1),
        prior=known.covariance(rows) + np.diag(wide),
        taken=taken[rows],
        weighed=np.arange(len(weighed)),
        share=settings.displaced_share,
        sigma_m=settings.displaced_sigma_m,
    ).probabilities()
    return moved


def _taken(problem: Problem, component: Component) -> Flags:
    """(n,) mapped objects that the history of a component assumes to be displaced."""
    ids = problem.places_on_map.ids
    if not problem.displaced.elsewhere:
        return np.zeros(len(ids), dtype=bool)
    return np.array([existence_of(component, number) == 0.0 for number in ids], dtype=bool)


def _farthest(distances: Array) -> Index:
    """Rows, ascending, of the objects that are weighed: those of the largest Mahalanobis ``distances`` (n,)."""
    return np.sort(np.argsort(-distances, kind="stable")[:MOST])
