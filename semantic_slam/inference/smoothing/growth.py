"""Components grow together: the children of one keyframe, whose smoothers settle in the same rounds."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from semantic_slam.inference.models.step import AssociatedDetection, Motion
from semantic_slam.inference.smoothing.batch_update import update_all
from semantic_slam.inference.smoothing.component import Component, ComponentUpdate
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.smoothing.keyframe_factors import KeyframeFactors

Outcome = Component | LostComponentError


def grow_all(
    parents: Sequence[Component],
    motion: Motion,
    observed: Sequence[Sequence[AssociatedDetection]],
    continued: Sequence[ComponentUpdate],
    *,
    in_place: bool = False,
) -> list[Outcome]:
    """A child of each parent; an error stands for one that is indeterminate.

    Parents stay as they were, unless an only child may use up its parent ``in_place``.
    """
    if not parents:
        return []
    rows = list(zip(parents, observed, continued, strict=True))
    spaces = parents[0].spaces
    space = spaces.robot
    predicted = space.compose(np.array([parent.newest_robot() for parent in parents]), motion.control)
    moved = np.abs(space.local(predicted, np.array([what.robot for what in continued]))).max(axis=-1).tolist()
    shared = KeyframeFactors(spaces, parents[0].model, parents[0].keyframe + 1, motion)
    extensions = [
        parent.extension(shared, seen, what, state, change)
        for (parent, seen, what), state, change in zip(rows, predicted, moved, strict=True)
    ]
    smoothers = update_all([parent.smoother for parent in parents], extensions, alone(parents) if in_place else ())
    return [
        own if isinstance(own, LostComponentError) else parent.child(seen, what, own)
        for (parent, seen, what), own in zip(rows, smoothers, strict=True)
    ]


def alone(parents: Sequence[object]) -> list[int]:
    """Which of some parents have one child."""
    times = Counter(id(parent) for parent in parents)
    return [row for row, parent in enumerate(parents) if times[id(parent)] == 1]


def certain(outcome: Outcome) -> Component:
    """The component. Raises LostComponentError where it is indeterminate."""
    if isinstance(outcome, LostComponentError):
        raise outcome
    return outcome
