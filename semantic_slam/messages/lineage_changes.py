"""Changes to a history, as they are told behind the objects of a keyframe's detections.

-2, and then for each keyframe, detection, object from now on, object before; rows of one message are padded with -2.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from semantic_slam.errors import MessageError
from semantic_slam.inference.states.lineage import LineageStep, Reassigned

CHANGED = -2
"""Where changes begin, and what rows are padded with: no object, and no false alarm."""


def with_changes(association: Sequence[int], changes: Sequence[Reassigned]) -> list[int]:
    """Objects of the detections, and behind them what else is changed."""
    return [*association, *([CHANGED] if changes else []), *(number for change in changes for number in change)]


def changes_in(numbers: Sequence[int]) -> tuple[Reassigned, ...]:
    """What stands behind the objects of the detections. Raises MessageError."""
    told = [number for number in numbers if number != CHANGED]
    if len(told) % 4:
        raise MessageError("associations: a change that does not name keyframe, detection and two objects")
    return tuple((told[at], told[at + 1], told[at + 2], told[at + 3]) for at in range(0, len(told), 4))


def step_of(association: Sequence[int], classes: Sequence[int], mode: int) -> LineageStep:
    """A step as it was told. Raises MessageError."""
    count = association.index(CHANGED) if CHANGED in association else len(association)
    if len(classes) < count:
        raise MessageError(f"class_assignments: {len(classes)} classes of {count} detections")
    return LineageStep.of(association[:count], classes[:count], mode, changes_in(association[count:]))


def padded(rows: Sequence[Sequence[int]], width: int = 0) -> NDArray[np.int32]:
    """(n, W) of equal length, at least ``width``."""
    width = max([width, *(len(row) for row in rows)])
    found = np.full((len(rows), width), CHANGED, dtype=np.int32)
    for at, row in enumerate(rows):
        found[at, : len(row)] = row
    return found
