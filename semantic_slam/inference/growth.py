"""Components grow together: the children of one keyframe, whose smoothers settle in the same rounds."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from semantic_slam.inference.component import Component, Continued, Motion, Observed
from semantic_slam.inference.keyframe_factors import KeyframeFactors
from semantic_slam.inference.settling import extend_all
from semantic_slam.inference.smoother import LostComponentError

Outcome = Component | LostComponentError


def grow_all(
    parents: Sequence[Component],
    motion: Motion,
    observed: Sequence[Sequence[Observed]],
    continued: Sequence[Continued],
    *,
    in_place: bool = False,
) -> list[Outcome]:
    """A child of each parent; an error stands for one that is indeterminate.

    Parents stay as they were, unless an only child may use up its parent ``in_place``.
    """
    if not parents:
        return []
    rows = list(zip(parents, observed, continued, strict=True))
    manifold = parents[0].manifold
    predicted = manifold.compose(np.array([parent.newest_robot() for parent in parents]), motion.control)
    moved = np.abs(manifold.local(predicted, np.array([what.robot for what in continued]))).max(axis=-1).tolist()
    shared = KeyframeFactors(manifold, parents[0].model, parents[0].keyframe + 1, motion)
    extensions = [
        parent.extension(shared, seen, what, state, change)
        for (parent, seen, what), state, change in zip(rows, predicted, moved, strict=True)
    ]
    smoothers = extend_all([parent.smoother for parent in parents], extensions, alone(parents) if in_place else ())
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
