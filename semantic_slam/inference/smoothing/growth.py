"""Components grow together: the children of one keyframe, whose smoothers converge in the same rounds."""

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

from semantic_slam.geometry.arrays import Flags
from semantic_slam.inference.models.step import Motion
from semantic_slam.inference.smoothing.batch_update import update_all
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.component_update import ComponentUpdate
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.smoothing.extension import (
    JUMP,
    classed_measurements,
    extension,
    linearisation_start,
    new_factors,
)
from semantic_slam.inference.smoothing.isam import AT_ONCE
from semantic_slam.inference.smoothing.keyframe_factors import KeyframeFactors

Outcome = Component | LostComponentError
Noise = tuple[int, bool]
"""Which of the noises a component takes robot and sensor to have, and whether its next motion slips."""


def grow(
    parents: Sequence[Component],
    motion: Motion,
    updates: Sequence[ComponentUpdate],
    *,
    in_place: bool = False,
    max_fresh: int = 0,
) -> list[Outcome]:
    """A child of each parent; an error stands for one that is indeterminate.

    Parents stay as they were, unless an only child may consume its parent's smoother ``in_place``. Where states are
    tracked, ``max_fresh`` objects at most get fresh marginals besides those observed.
    """
    if not parents:
        return []
    grown = _stepped if parents[0].single_steps else _converged
    return grown(parents, _shared(parents, motion), updates, in_place, max_fresh)


def _converged(
    parents: Sequence[Component],
    shared: dict[Noise, KeyframeFactors],
    updates: Sequence[ComponentUpdate],
    in_place: bool,
    max_fresh: int,
) -> list[Outcome]:
    """Outcomes of updates taken together, until they converge."""
    moved = _moved(parents, updates)
    extensions = [
        extension(parent, shared[_noise(parent)], update, moved=bool(far))
        for parent, update, far in zip(parents, updates, moved, strict=True)
    ]
    before = [parent.smoother for parent in parents]
    smoothers = update_all(before, extensions, only_children(before) if in_place else ())
    return [
        outcome if isinstance(outcome, LostComponentError) else _attempt(parent.child, update, outcome, max_fresh)
        for parent, update, outcome in zip(parents, updates, smoothers, strict=True)
    ]


def _stepped(
    parents: Sequence[Component],
    shared: dict[Noise, KeyframeFactors],
    updates: Sequence[ComponentUpdate],
    in_place: bool,
    max_fresh: int,
) -> list[Outcome]:
    """Outcomes of one update each, one after another, the next keyframe going on; a last child may consume a parent.

    Descriptors stay with their records: they enter with a turn of their object, which one update cannot make.
    """
    last = {id(parent.smoother): place for place, parent in enumerate(parents)} if in_place else {}
    moved = _moved(parents, updates)

    def child(place: int, parent: Component, update: ComponentUpdate) -> Component:
        graph, values = new_factors(parent, shared[_noise(parent)], update)
        classed, start = classed_measurements(parent, update), linearisation_start(parent, update)
        mine = parent.smoother if last.get(id(parent.smoother)) == place else parent.smoother.fork()
        far = bool(moved[place])
        measured = [] if mine.in_charts is None else shared[_noise(parent)].measured(parent, update)
        smoother = mine.stepped(graph, values, classed, start, again=far, measured=measured)
        return parent.child(update, smoother, max_fresh, far=far)

    return [_attempt(child, place, *pair) for place, pair in enumerate(zip(parents, updates, strict=True))]


def only_children(parents: Sequence[object]) -> list[int]:
    """Which of some parents have one child."""
    times = Counter(id(parent) for parent in parents)
    return [row for row, parent in enumerate(parents) if times[id(parent)] == 1]


def certain(outcome: Outcome) -> Component:
    """The component. Raises LostComponentError where it is indeterminate."""
    if isinstance(outcome, LostComponentError):
        raise outcome
    return outcome


def _moved(parents: Sequence[Component], updates: Sequence[ComponentUpdate]) -> Flags:
    """(K,) whether the mode of the robot is elsewhere than odometry has it; far, where updates are not iterated.

    Where errors repeat, what a detection tells besides is so sharp that less is far.
    """
    space = parents[0].spaces.robot
    predicted, modes = (np.array([getattr(update, name) for update in updates]) for name in ("predicted", "robot"))
    limit = np.maximum(JUMP, space.far) if parents[0].single_steps else JUMP
    if parents[0].smoother.in_charts is not None:
        limit = AT_ONCE * space.relinearize_threshold
    return np.asarray((np.abs(space.local(predicted, modes)) > limit).any(axis=-1))


def _noise(parent: Component) -> Noise:
    return parent.noise, parent.slip is not None


def _shared(parents: Sequence[Component], motion: Motion) -> dict[Noise, KeyframeFactors]:
    """The factors of the keyframe under each of the noises that odometry may have."""
    by_noise = {_noise(parent): parent for parent in parents}
    return {
        noise: KeyframeFactors(component.spaces, component.model, component.keyframe + 1, motion)
        for noise, component in by_noise.items()
    }


def _attempt(make: Callable[..., Component], *arguments: object) -> Outcome:
    """A component that is lost on the way stands for itself alone."""
    try:
        return make(*arguments)
    except LostComponentError as fault:
        return fault
