"""What a detector does to the boxes of a frame: one thing twice, in two halves, or two things as one."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array

JITTER = 0.03
"""Standard deviation of the edges of a second box, as a share of its sides."""
HALF = 0.55
"""Share of the width that each half of a split box has."""
NEAR = 0.05
"""Share of the picture's width within which two boxes may be merged."""


@dataclass(frozen=True, kw_only=True)
class BoxFaults:
    """Shares of the boxes; all by chance."""

    doubled: float = 0.0  # that come with a second one of the same outline, named anew
    split: float = 0.0  # that come as a left and a right half
    merged: float = 0.0  # of neighbours in the picture that come as one around both


@dataclass(frozen=True, kw_only=True)
class Box:
    """A box, and the true object that it shows most of."""

    edges: Array  # (4,) x_min y_min x_max y_max, pixels
    object_id: str
    is_second: bool = False  # besides one that has its true name


def torn(boxes: list[Box], faults: BoxFaults, width: int, random: np.random.Generator) -> list[Box]:
    """The boxes as that detector draws them, from left to right; a picture ``width`` pixels wide."""
    return [part for box in _merged(boxes, faults, width, random) for part in _parts(box, faults, random)]


def _merged(boxes: list[Box], faults: BoxFaults, width: int, random: np.random.Generator) -> list[Box]:
    found: list[Box] = []
    for box in sorted(boxes, key=lambda own: float(own.edges[0])):
        is_near = bool(found) and box.edges[0] - found[-1].edges[2] < NEAR * width
        if is_near and random.random() < faults.merged:
            found[-1] = _around(found[-1], box)
        else:
            found.append(box)
    return found


def _around(one: Box, other: Box) -> Box:
    low, high = np.minimum(one.edges[:2], other.edges[:2]), np.maximum(one.edges[2:], other.edges[2:])
    larger = max((one, other), key=lambda own: float(np.prod(own.edges[2:] - own.edges[:2])))
    return Box(edges=np.concatenate([low, high]), object_id=larger.object_id)


def _parts(box: Box, faults: BoxFaults, random: np.random.Generator) -> list[Box]:
    kind = random.random()
    if kind < faults.split:
        share = HALF * (box.edges[2] - box.edges[0])
        left, right = box.edges.copy(), box.edges.copy()
        left[2], right[0] = box.edges[0] + share, box.edges[2] - share
        return [Box(edges=left, object_id=box.object_id), Box(edges=right, object_id=box.object_id)]
    if kind < faults.split + faults.doubled:
        sides = np.tile(box.edges[2:] - box.edges[:2], 2)
        again = box.edges + JITTER * sides * random.standard_normal(4)
        return [box, Box(edges=again, object_id=box.object_id, is_second=True)]
    return [box]
