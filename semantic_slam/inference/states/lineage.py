"""What a hypothesis is made of: one step for every keyframe."""

from dataclasses import dataclass


@dataclass(frozen=True)
class LineageStep:
    """What one keyframe added to a hypothesis."""

    association: tuple[int, ...]  # (D,) object id per detection, -1 clutter
    class_assignment: tuple[int, ...]  # (D,) class of that object, -1 when classes are not enumerated
    mode: int = 0
