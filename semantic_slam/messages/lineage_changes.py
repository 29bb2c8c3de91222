"""Wire format of changes to an association history, appended to a keyframe's association row.

The row continues with -2, then for each change: keyframe, detection, new object, old object. Rows of one message are
padded with -2.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from semantic_slam.errors import MessageError
from semantic_slam.inference.states.lineage import LineageStep, Reassigned

CHANGED = -2
"""Marker that starts the changes, and padding value; it is neither an object id nor a false alarm."""


def with_changes(association: Sequence[int], changes: Sequence[Reassigned]) -> list[int]:
    """Association row of the detections, followed by the changes."""
    return [*association, *([CHANGED] if changes else []), *(number for change in changes for number in change)]


def changes_in(numbers: Sequence[int]) -> tuple[Reassigned, ...]:
    """Parse the changes that follow an association row. Raises MessageError."""
    told = [number for number in numbers if number != CHANGED]
    if len(told) % 4:
        raise MessageError("associations: a change that does not name keyframe, detection and two objects")
    return tuple((told[at], told[at + 1], told[at + 2], told[at + 3]) for at in range(0, len(told), 4))


def step_of(association: Sequence[int], classes: Sequence[int], mode: int) -> LineageStep:
    """Parse a lineage step from its wire format. Raises MessageError."""
    count = association.index(CHANGED) if CHANGED in association else len(association)
    if len(classes) < count:
        raise MessageError(f"class_assignments: {len(classes)} classes of {count} detections")
    return LineageStep.of(association[:count], classes[:count], mode, changes_in(association[count:]))


def padded(rows: Sequence[Sequence[int]], width: int = 0) -> NDArray[np.int32]:
    """(n, W) rows padded to equal length, at least ``width``."""
    width = max([width, *(len(row) for row in rows)])
    found = np.full((len(rows), width), CHANGED, dtype=np.int32)
    for at, row in enumerate(rows):
        found[at, : len(row)] = row
    return found
