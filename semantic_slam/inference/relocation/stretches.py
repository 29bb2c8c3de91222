"""Stretches of a drive separated by blind ones, and the history that recognises nothing across a blind stretch."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from semantic_slam.geometry.arrays import Index
from semantic_slam.geometry.moments import position_sigmas
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.states.lineage import Lineage, LineageStep

BLIND_SIGMA_M, AWAY_M = 0.5, 3.0
"""A motion is blind if it adds this standard deviation to a place this far away, which may then be mistaken."""


def stretches(steps: Sequence[Step]) -> Index:
    """(T,) number of blind motions up to each keyframe."""
    if not steps:
        return np.zeros(0, dtype=int)
    covariances = np.array([step.motion.covariance for step in steps])
    variances = position_sigmas(covariances) ** 2 + AWAY_M**2 * covariances[:, 2, 2]
    return np.asarray(np.cumsum(variances > BLIND_SIGMA_M**2))


def parted(lineage: Sequence[LineageStep], own: Index, first_new_id: Callable[[int], int]) -> Lineage:
    """The history in which every object is seen in one stretch only; (T,) ``own`` stretches of the keyframes.

    An object seen again in another stretch is started anew; ``first_new_id``: id of a keyframe's first detection.
    """
    seen_in: dict[int, int] = {}
    names: dict[int, int] = {}
    found: list[LineageStep] = []
    for keyframe, step in enumerate(lineage):
        stretch, association = int(own[keyframe]), list(step.association)
        for number, object_id in enumerate(step.association):
            if object_id < 0:
                continue
            if seen_in.setdefault(object_id, stretch) != stretch:
                seen_in[object_id], names[object_id] = stretch, first_new_id(keyframe) + number
            association[number] = names.get(object_id, object_id)
        found.append(replace(step, association=tuple(association)))
    return tuple(found)
