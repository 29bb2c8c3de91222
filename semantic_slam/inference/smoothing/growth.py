"""Batched growth: the children of one keyframe are updated together, their smoothers iterating in the same rounds."""

from collections import Counter
from collections.abc import Callable, Sequence

import gtsam
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
from semantic_slam.inference.smoothing.keyframe_factors import KeyframeFactors
from semantic_slam.inference.smoothing.linear.new_measurements import NewMeasurements, linearised_at_once
from semantic_slam.inference.smoothing.solver.isam import AT_ONCE

Outcome = Component | LostComponentError
Noise = tuple[int, bool]
"""Which noise setting a component assumes for robot and sensor, and whether it assumes slip in the next motion."""


def grow(
    parents: Sequence[Component],
    motion: Motion,
    updates: Sequence[ComponentUpdate],
    *,
    in_place: bool = False,
    max_fresh: int = 0,
) -> list[Outcome]:
    """One child per parent; a LostComponentError in its place where its system is indeterminate.

    Parents stay usable, unless ``in_place`` lets an only child consume its parent's smoother. Where states are tracked,
    marginal covariances of all objects are recomputed if there are at most ``max_fresh``, else those of the objects
    observed.
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
    """Children whose updates are iterated together until they converge."""
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
    """Children after one update each, not iterated: the next keyframe continues. A parent's last child may consume it.

    Descriptors are no variables here, but stay with the objects' view records: they would enter with a turn of their
    object, which one update cannot make.
    """
    last = {id(parent.smoother): place for place, parent in enumerate(parents)} if in_place else {}
    moved = _moved(parents, updates)
    added = [
        new_factors(parent, shared[_noise(parent)], update) for parent, update in zip(parents, updates, strict=True)
    ]
    new = _new_measurements(parents, shared, updates, [values for _, values in added])

    def child(place: int, parent: Component, update: ComponentUpdate) -> Component:
        classed, start = classed_measurements(parent, update), linearisation_start(parent, update)
        mine = parent.smoother if last.get(id(parent.smoother)) == place else parent.smoother.fork()
        far = bool(moved[place])
        smoother = mine.stepped(*added[place], classed, start, again=far, new=new[place])
        return parent.child(update, smoother, max_fresh, far=far)

    return [_attempt(child, place, *pair) for place, pair in enumerate(zip(parents, updates, strict=True))]


def _new_measurements(
    parents: Sequence[Component],
    shared: dict[Noise, KeyframeFactors],
    updates: Sequence[ComponentUpdate],
    values: Sequence[gtsam.Values],
) -> Sequence[NewMeasurements | None]:
    """The keyframe's measurements, linearised in each child's charts; None where smoothers hold none."""
    if parents[0].smoother.in_charts is None:
        return [None for _ in parents]
    rows = zip(parents, updates, values, strict=True)
    return linearised_at_once(
        [
            parent.smoother.with_charts(own, shared[_noise(parent)].measured(parent, update))
            for parent, update, own in rows
        ]
    )


def only_children(parents: Sequence[object]) -> list[int]:
    """Rows of the parents that have one child alone."""
    times = Counter(id(parent) for parent in parents)
    return [row for row, parent in enumerate(parents) if times[id(parent)] == 1]


def certain(outcome: Outcome) -> Component:
    """The component of an outcome. Raises LostComponentError where it is indeterminate."""
    if isinstance(outcome, LostComponentError):
        raise outcome
    return outcome


def _moved(parents: Sequence[Component], updates: Sequence[ComponentUpdate]) -> Flags:
    """(K,) whether the mode of the robot's pose is far from the odometry prediction.

    The limit is higher where updates are not iterated. Where detection errors are correlated, detections are so precise
    beyond them that another limit holds: ``AT_ONCE`` relinearisation thresholds.
    """
    space = parents[0].spaces.robot
    predicted, modes = (np.array([getattr(update, name) for update in updates]) for name in ("predicted", "robot"))
    limit = np.maximum(JUMP, space.far) if parents[0].single_steps else JUMP
    if parents[0].smoother.in_charts is not None:
        limit = AT_ONCE * space.relinearize_threshold
    return np.asarray((np.abs(space.local(predicted, modes)) > limit).any(axis=-1))


def _noise(parent: Component) -> Noise:
    return parent.noise_index, parent.slip is not None


def _shared(parents: Sequence[Component], motion: Motion) -> dict[Noise, KeyframeFactors]:
    """The keyframe's factors under each noise setting that some parent assumes."""
    by_noise = {_noise(parent): parent for parent in parents}
    return {
        noise: KeyframeFactors(component.spaces, component.model, component.keyframe + 1, motion)
        for noise, component in by_noise.items()
    }


def _attempt(make: Callable[..., Component], *arguments: object) -> Outcome:
    """The component that ``make`` returns, or its LostComponentError: one lost component does not affect the others."""
    try:
        return make(*arguments)
    except LostComponentError as fault:
        return fault
