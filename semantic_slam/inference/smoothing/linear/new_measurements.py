"""A keyframe's measurements in all its hypotheses, linearised at once, each in the charts of its own smoother."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.smoothing.linear.linear_measurements import LinearFactors, LinearMeasurements
from semantic_slam.inference.smoothing.linear.located import Located, Stepped
from semantic_slam.inference.smoothing.linear.measured import Measured, Motions, Sightings, joined


@dataclass(frozen=True, kw_only=True)
class NewMeasurements:
    """What a keyframe adds to the linear factors of one smoother."""

    factors: LinearFactors  # with the charts of new variables
    at: Located  # all estimates, those of new variables included
    values: gtsam.Values  # new variables at the base points of their charts
    measured: list[Measured]
    made: tuple[LinearMeasurements, ...] = ()  # the measurements linearised, see :func:`linearised_at_once`

    @classmethod
    def of(cls, before: LinearFactors, at: Located, values: gtsam.Values, measured: Sequence[Measured]) -> Self:
        """From estimates ``at`` before, and new variables estimated at ``values``; nothing is linearised yet."""
        charts, at, values = before.charts.extended(values, at)
        return cls(
            factors=replace(before, charts=charts),
            at=at,
            values=values,
            measured=_with_offsets(measured, values, charts.vectors),
        )


def linearised_at_once(new: Sequence[NewMeasurements]) -> list[NewMeasurements]:
    """The measurements of several smoothers linearised in their charts: in each first motions, then sightings.

    They are evaluated as one batch of each kind; the result for one smoother is independent of the others.
    """
    made: list[tuple[LinearMeasurements, ...]] = [() for _ in new]
    for kind in (Motions, Sightings):
        places = [(row, own) for row, each in enumerate(new) for own in each.measured if isinstance(own, kind)]
        if not places:
            continue
        of, (spaces, model) = joined([own for _, own in places]), (new[0].factors.charts.spaces, new[0].factors.model)
        sides = zip(*(own.sides(new[row].at) for row, own in places), strict=True)
        first, second = (Stepped.joined(parts) for parts in sides)
        begun, here = (of.measured(spaces, model, *pair) for pair in ((first.begun, second.begun), (first, second)))
        every, end = LinearMeasurements.made(of, begun, here), 0
        for row, own in places:
            start, end = end, end + len(own.rows)
            made[row] += (every.part(own, np.arange(start, end)),)
    return [replace(each, made=own) for each, own in zip(new, made, strict=True)]


def _with_offsets(measured: Sequence[Measured], values: gtsam.Values, known: Mapping[int, Array]) -> list[Measured]:
    """Measurements with correlated errors and biases at their chart origins: from ``values`` if new, else ``known``."""

    def point(key: int) -> Array:
        return np.asarray(values.atVector(key)) if values.exists(key) else known[key]

    return [own.with_offsets(point) for own in measured]
