"""The differences between two association histories, as changed object ids."""

from collections.abc import Sequence

from semantic_slam.inference.states.lineage import LineageStep

Change = tuple[int, int, int]
"""Keyframe, detection, and the object id with which it is associated, or -1."""


def differences(told: Sequence[LineageStep], other: Sequence[LineageStep]) -> tuple[Change, ...]:
    """Where ``other`` associates detections with different objects than ``told``; both cover the same keyframes.

    Histories with a common ancestor share its step objects: from the newest shared step back they are taken to agree.
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
