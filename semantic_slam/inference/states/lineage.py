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

COMPONENT_MODES = 32
"""More modes than a component has."""
SLIP = COMPONENT_MODES
"""Added to ``LineageStep.mode`` where the motion before the step slipped."""
POINT = 2 * SLIP
"""Factor of the lattice point's number in ``LineageStep.mode``."""

Value = TypeVar("Value", int, tuple[int, ...])


@lru_cache(maxsize=1 << 14, typed=True)
def _the_one(value: Value) -> Value:
    """Intern a value: the first of all equal ones."""
    return value


@dataclass(frozen=True, slots=True)
class LineageStep:
    """The choices of a hypothesis at one keyframe: association, classes, mode, and reassociations of the past.

    ``mode`` is the number of the component's posterior mode, plus ``SLIP`` where the motion slipped, plus ``POINT``
    times the number of the lattice point to which a kidnapped robot was carried. At the first keyframe of an open world
    it is the root number instead. That of a newest step fits into 16 bits: only replays choose lattice points and
    starts, and always at earlier keyframes (newly at most ``NEW_GROUND``), whose modes are sent with 32 bits.
    """

    association: tuple[int, ...]  # (D,) object id per detection, -1 clutter
    class_assignment: tuple[int, ...]  # (D,) class of that object, -1 when classes are not enumerated, MOVES
    mode: int = 0
    changes: tuple[Reassigned, ...] = ()  # reassociations made before this keyframe; earlier steps have them already

    @classmethod
    def of(
        cls, association: Iterable[int], classes: Iterable[int], mode: int = 0, changes: tuple[Reassigned, ...] = ()
    ) -> Self:
        """Make a step with interned numbers, to save memory: long lineages name the same few objects in every step."""
        return cls(tuple(map(_the_one, association)), _the_one(tuple(classes)), mode, changes)

    @property
    def component_mode(self) -> int:
        """Number of the component's posterior mode."""
        return self.mode % COMPONENT_MODES

    @property
    def slipped(self) -> bool:
        """Whether the motion before the step slipped; the step must not be the first one."""
        return self.mode % POINT >= SLIP

    @property
    def lattice_point(self) -> int:
        """The lattice point to which the robot was carried before the step, which must not be the first one.

        0 (``NOWHERE``): it was not carried.
        """
        return self.mode // POINT

    def with_slip(self) -> Self:
        """The step, marked as following a motion that slipped."""
        return replace(self, mode=self.mode | SLIP)

    def without_slip(self) -> Self:
        """The step without the mark of a slip."""
        return replace(self, mode=self.mode & ~SLIP)

    def with_lattice_point(self, number: int) -> Self:
        """The step, with the robot carried to a lattice point before it; 0 (``NOWHERE``): not carried."""
        return replace(self, mode=self.mode % POINT + POINT * number)


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
