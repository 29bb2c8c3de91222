"""Pairs of objects of one history that may be one and the same, and the histories in which they are merged."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.object_table import ObjectTable
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.states.keys import object_key
from semantic_slam.inference.states.lineage import Lineage, movers_of

LARGEST_DISTANCE = 4.0
"""Mahalanobis distance between two objects up to which they may be merged."""
LARGEST_DISTANCE_M = 3.0
"""Distance between them [m] up to which they may be merged."""
LEAST_EXISTENCE = 0.1

Pair = tuple[int, ...]
"""The older object and the younger one."""


def near_pairs(
    ids: Sequence[int], objects: ObjectTable, lineage: Lineage, num_axes: int, farthest: float = LARGEST_DISTANCE
) -> list[Pair]:
    """Pairs (older, younger) of objects near enough to be one and never seen in one frame; nearest first.

    Objects that may move are left out: where they are now is not where they were. ``num_axes`` of their places: 2 or 3.
    ``farthest``: Mahalanobis distance, errors that both share aside.
    """
    places, spreads = objects.object_poses[:, :num_axes], objects.object_covariances[:, :num_axes, :num_axes]
    movers = movers_of(lineage)
    alive = [row for row, number in enumerate(ids) if objects.existence[row] > LEAST_EXISTENCE and number not in movers]
    together = seen_together(lineage)
    found: list[tuple[float, Pair]] = []
    for one, other in combinations(alive, 2):
        pair = min(ids[one], ids[other]), max(ids[one], ids[other])
        offset = places[one] - places[other]
        if pair in together or not np.linalg.norm(offset) <= LARGEST_DISTANCE_M:
            continue
        distance = float(np.sqrt(offset @ np.linalg.solve(spreads[one] + spreads[other], offset)))
        if distance <= farthest:
            found.append((distance, pair))
    return [pair for _, pair in sorted(found)]


def relative_positions(component: Component, pairs: Sequence[Pair]) -> tuple[Array, Array]:
    """(n, p) positions [m] of each pair's younger object relative to the older one; (n, n, p, p) joint covariances.

    In map, of the joint Gaussian: errors that both share, such as the drift of a whole drive, cancel. Raises
    LostComponentError where it cannot be computed.
    """
    numbers, space = sorted({number for pair in pairs for number in pair}), component.spaces.landmark
    keys, rows = [object_key(number) for number in numbers], {number: row for row, number in enumerate(numbers)}
    states, size = component.states(keys)[:, : space.storage_size], space.tangent_size
    joint = component.joint_covariance(keys).reshape(len(keys), size, len(keys), size)
    places, slopes = space.position(states), space.position_slopes(states)
    between = np.einsum("ial,iljm,jbm->ijab", slopes, joint, slopes, optimize=True)  # (N, N, p, p) of positions
    older, younger = (np.array([rows[pair[end]] for pair in pairs], dtype=int) for end in (0, 1))
    change = between[younger] - between[older]
    return places[younger] - places[older], change[:, younger] - change[:, older]


def relative_distances(component: Component, pairs: Sequence[Pair]) -> Array:
    """(n,) Mahalanobis distances of :func:`relative_positions`, infinite where these cannot be computed."""
    try:
        offsets, spreads = relative_positions(component, pairs)
    except LostComponentError:
        return np.full(len(pairs), np.inf)
    own = spreads[np.arange(len(pairs)), np.arange(len(pairs))]
    return np.asarray(np.sqrt(np.vecdot(offsets, np.linalg.solve(own, offsets[..., None])[..., 0])))


def seen_together(lineage: Lineage) -> set[Pair]:
    """Pairs of objects that were detected in one frame."""
    return {pair for step in lineage for pair in combinations(sorted(n for n in step.association if n >= 0), 2)}


def merged(lineage: Lineage, pairs: Sequence[Pair]) -> Lineage:
    """The history in which the younger object of each pair is merged into the older one."""
    names = {younger: older for older, younger in pairs}
    return tuple(
        replace(step, association=tuple(names.get(number, number) for number in step.association)) for step in lineage
    )


def apart(pairs: Sequence[Pair]) -> list[Pair]:
    """Pairs that can be merged at once: no two share an object."""
    chosen: list[Pair] = []
    taken: set[int] = set()
    for pair in pairs:
        if not taken & set(pair):
            chosen.append(pair)
            taken |= set(pair)
    return chosen
