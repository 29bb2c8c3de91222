"""What a hypothesis is made of: one step for every keyframe."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Index

MOVES = -2
"""In place of a class, of a detection whose object moves: one history has it standing still, another one moving."""


@dataclass(frozen=True)
class LineageStep:
    """What one keyframe added to a hypothesis."""

    association: tuple[int, ...]  # (D,) object id per detection, -1 clutter
    class_assignment: tuple[int, ...]  # (D,) class of that object, -1 when classes are not enumerated, MOVES
    mode: int = 0  # in an open world, of the first keyframe: under which noise, and from which start, a history begins


def lineage_steps(
    objects: Index, classes: Index | None, numbers: Index | None, used: Index, count: int
) -> list[LineageStep]:
    """Steps of K candidates, in which (n,) of ``count`` detections are ``used`` and the others are clutter.

    ``objects`` (K, n) are ids, -1 clutter; ``classes`` (K, n) and ``numbers`` (K,) of modes where there are any.
    """
    association = np.full((len(objects), count), -1)
    association[:, used] = objects
    assignment = np.full((len(objects), count), -1)
    if classes is not None:
        assignment[:, used] = classes
    modes: Sequence[int] = [0] * len(objects) if numbers is None else numbers.tolist()
    rows = zip(association.tolist(), assignment.tolist(), modes, strict=True)
    return [LineageStep(tuple(a), tuple(c), mode) for a, c, mode in rows]
