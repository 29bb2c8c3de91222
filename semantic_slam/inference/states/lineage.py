"""The lineage of a hypothesis: its discrete history, one step for every keyframe, which determines its component."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Self, TypeVar

import numpy as np

from semantic_slam.geometry.arrays import Index
from semantic_slam.inference.states.identity import hypothesis_id

MOVES = -2
"""In place of a class: the history takes the detection's object for a moving one, while another takes it as static."""

Reassigned = tuple[int, int, int, int]
"""Reassociation of a past detection: its keyframe and number, the new object id, and the old one."""

Value = TypeVar("Value", int, tuple[int, ...])


@lru_cache(maxsize=1 << 14, typed=True)
def _the_one(value: Value) -> Value:
    """Intern a value: the first of all equal ones."""
    return value


@dataclass(frozen=True, slots=True)
class LineageStep:
    """The choices of a hypothesis at one keyframe: association, classes, mode, and reassociations of the past."""

    association: tuple[int, ...]  # (D,) object id per detection, -1 clutter
    class_assignment: tuple[int, ...]  # (D,) class of that object, -1 when classes are not enumerated, MOVES
    mode: int = 0  # posterior mode, slip and kidnapping; open world, first keyframe: root number (noise and start)
    changes: tuple[Reassigned, ...] = ()  # reassociations made before this keyframe; earlier steps have them already

    @classmethod
    def of(
        cls, association: Iterable[int], classes: Iterable[int], mode: int = 0, changes: tuple[Reassigned, ...] = ()
    ) -> Self:
        """Make a step with interned numbers, to save memory: long lineages name the same few objects in every step."""
        return cls(tuple(map(_the_one, association)), _the_one(tuple(classes)), mode, changes)


Lineage = tuple[LineageStep, ...]
"""A hypothesis's history of data associations, one step per keyframe."""


def next_id(parent_id: int, stamp_ns: int, step: LineageStep) -> int:
    """Id of the child hypothesis to which a keyframe's step leads."""
    return hypothesis_id(parent_id, stamp_ns, step.association, step.class_assignment, step.mode, step.changes)


def movers_of(lineage: Sequence[LineageStep]) -> set[int]:
    """Ids of the objects that a history takes for ones that move or may move."""
    pairs = (pair for step in lineage for pair in zip(step.association, step.class_assignment, strict=True))
    return {n for n, kind in pairs if kind == MOVES}


def revised(lineage: Sequence[LineageStep], changes: Sequence[Reassigned]) -> Lineage:
    """Apply reassociations of past detections to a lineage; unaffected steps stay the same objects."""
    steps = list(lineage)
    for keyframe, detection, object_id, _ in changes:
        association = list(steps[keyframe].association)
        association[detection] = object_id
        steps[keyframe] = replace(steps[keyframe], association=tuple(association))
    return tuple(steps)


def as_followed(lineage: Sequence[LineageStep]) -> Lineage:
    """The lineage for a replay in order: each reassociation takes effect at the step that made it, and not before."""
    steps = tuple(lineage)
    for step in reversed(lineage):
        steps = revised(steps, [(keyframe, number, before, now) for keyframe, number, now, before in step.changes])
    return steps


def lineage_steps(
    objects: Index, classes: Index | None, numbers: Index | None, used: Index, count: int
) -> list[LineageStep]:
    """Lineage steps of K candidates; of ``count`` detections the (n,) ``used`` ones are associated, others are clutter.

    ``objects`` (K, n) are ids, -1 clutter; ``classes`` (K, n) and ``numbers`` (K,) of modes are None where unused.
    """
    association = np.full((len(objects), count), -1)
    association[:, used] = objects
    assignment = np.full((len(objects), count), -1)
    if classes is not None:
        assignment[:, used] = classes
    modes: Sequence[int] = [0] * len(objects) if numbers is None else numbers.tolist()
    rows = zip(association.tolist(), assignment.tolist(), modes, strict=True)
    return [LineageStep.of(a, c, mode) for a, c, mode in rows]
