"""In what two histories differ, told in objects."""

from collections.abc import Sequence

from semantic_slam.inference.states.lineage import LineageStep

Change = tuple[int, int, int]
"""Keyframe, detection, and the object id that it is of, or -1."""


def differences(told: Sequence[LineageStep], other: Sequence[LineageStep]) -> tuple[Change, ...]:
    """Where ``other`` associates detections with other objects than ``told``; both are of the same keyframes.

    Histories that grew from one share its steps: from the newest of these back they are taken to agree.
    """
    found: list[Change] = []
    for keyframe in range(len(told) - 1, -1, -1):
        one, two = told[keyframe], other[keyframe]
        if one is two:
            break
        found += [
            (keyframe, detection, number)
            for detection, number in enumerate(two.association)
            if number != one.association[detection]
        ]
    return tuple(sorted(found))
