"""What a hypothesis is made of: one step for every keyframe."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Self, TypeVar

import numpy as np

from semantic_slam.geometry.arrays import Index
from semantic_slam.inference.states.identity import hypothesis_id

MOVES = -2
"""In place of a class, of a detection whose object moves: one history has it standing still, another one moving."""

Reassigned = tuple[int, int, int, int]
"""Keyframe and detection of long ago, the object that it is taken to be of from now on, and that before."""

Value = TypeVar("Value", int, tuple[int, ...])


@lru_cache(maxsize=1 << 14, typed=True)
def _the_one(value: Value) -> Value:
    """The first of all equal values."""
    return value


@dataclass(frozen=True, slots=True)
class LineageStep:
    """What one keyframe added to a hypothesis."""

    association: tuple[int, ...]  # (D,) object id per detection, -1 clutter
    class_assignment: tuple[int, ...]  # (D,) class of that object, -1 when classes are not enumerated, MOVES
    mode: int = 0  # in an open world, of the first keyframe: under which noise, and from which start, a history begins
    changes: tuple[Reassigned, ...] = ()  # made before this keyframe; the steps before tell what is true since

    @classmethod
    def of(
        cls, association: Iterable[int], classes: Iterable[int], mode: int = 0, changes: tuple[Reassigned, ...] = ()
    ) -> Self:
        """With equal numbers kept once: lineages grow for days, and name the same few objects in every step."""
        return cls(tuple(map(_the_one, association)), _the_one(tuple(classes)), mode, changes)


def next_id(parent_id: int, stamp_ns: int, step: LineageStep) -> int:
    """Id of the hypothesis to which a keyframe's step leads."""
    return hypothesis_id(parent_id, stamp_ns, step.association, step.class_assignment, step.mode, step.changes)


def movers_of(lineage: Sequence[LineageStep]) -> set[int]:
    """Objects that a history takes for ones that move, or may."""
    pairs = (pair for step in lineage for pair in zip(step.association, step.class_assignment, strict=True))
    return {n for n, kind in pairs if kind == MOVES}


def revised(lineage: Sequence[LineageStep], changes: Sequence[Reassigned]) -> tuple[LineageStep, ...]:
    """The lineage in which detections of long ago are of other objects; steps without any stay the same."""
    steps = list(lineage)
    for keyframe, detection, object_id, _ in changes:
        association = list(steps[keyframe].association)
        association[detection] = object_id
        steps[keyframe] = replace(steps[keyframe], association=tuple(association))
    return tuple(steps)


def as_followed(lineage: Sequence[LineageStep]) -> tuple[LineageStep, ...]:
    """The lineage keyframe by keyframe as its history went: each change is made when its step comes, and not before."""
    steps = tuple(lineage)
    for step in reversed(lineage):
        steps = revised(steps, [(keyframe, number, before, now) for keyframe, number, now, before in step.changes])
    return steps


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
    return [LineageStep.of(a, c, mode) for a, c, mode in rows]
