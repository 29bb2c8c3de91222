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


def near_pairs(ids: Sequence[int], objects: ObjectTable, lineage: Lineage) -> list[Pair]:
    """Pairs (older, younger) of objects near enough to be one and never seen in one frame; nearest first.

    Objects that may move are left out: where they are now is not where they were.
    """
    places, spreads = objects.object_poses[:, :2], objects.object_covariances[:, :2, :2]
    movers = movers_of(lineage)
    alive = [row for row, number in enumerate(ids) if objects.existence[row] > LEAST_EXISTENCE and number not in movers]
    together = seen_together(lineage)
    found: list[tuple[float, Pair]] = []
    for one, other in combinations(alive, 2):
        pair = min(ids[one], ids[other]), max(ids[one], ids[other])
        offset = places[one] - places[other]
        if pair in together or not np.hypot(*offset) <= LARGEST_DISTANCE_M:
            continue
        distance = float(np.sqrt(offset @ np.linalg.solve(spreads[one] + spreads[other], offset)))
        if distance <= LARGEST_DISTANCE:
            found.append((distance, pair))
    return [pair for _, pair in sorted(found)]


def relative_distances(component: Component, pairs: Sequence[Pair]) -> Array:
    """(n,) Mahalanobis distances of the relative position of each pair, in their joint Gaussian.

    Errors that both share, such as the drift of a whole drive, cancel. Infinite where the joint Gaussian cannot be
    computed.
    """
    numbers, space = sorted({number for pair in pairs for number in pair}), component.spaces.landmark
    keys = [object_key(number) for number in numbers]
    try:
        states, covariance = component.states(keys), component.joint_covariance(keys)
    except LostComponentError:
        return np.full(len(pairs), np.inf)
    size = space.tangent_size
    axes = np.tile(np.eye(2, size), (len(numbers), 1, 1))  # (N, 2, l) axes of the tangent spaces, in map
    if space.heading is not None:
        cos, sin = np.cos(states[:, space.heading]), np.sin(states[:, space.heading])
        axes[:, :, :2] = np.stack([np.stack([cos, -sin], axis=1), np.stack([sin, cos], axis=1)], axis=1)
    found = []
    for pair in pairs:
        one, other = (numbers.index(number) for number in pair)
        rows = np.r_[one * size : (one + 1) * size, other * size : (other + 1) * size]
        slopes = np.concatenate([-axes[one], axes[other]], axis=1)
        offset = states[other, :2] - states[one, :2]
        spread = slopes @ covariance[np.ix_(rows, rows)] @ slopes.T
        found.append(float(np.sqrt(offset @ np.linalg.solve(spread, offset))))
    return np.array(found)


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
