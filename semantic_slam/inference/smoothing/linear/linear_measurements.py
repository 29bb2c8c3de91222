"""Measurements as iSAM2 holds them: linear in its charts, each with the slot that it has there."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array, Index, squared_norms
from semantic_slam.geometry.rows import joined_rows
from semantic_slam.inference.models.linear_factors import unit_noise
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.smoothing.linear.charts import Charts
from semantic_slam.inference.smoothing.linear.located import Located, Variables
from semantic_slam.inference.smoothing.linear.measured import Measured, Motions, Sightings, Slopes

_jacobian_factor: Any = gtsam.JacobianFactor  # of two or three keys, which its type does not say


@dataclass(frozen=True, kw_only=True)
class LinearMeasurements:
    """B measurements of one kind, m components each, of variables of d and e dimensions."""

    of: Measured  # B
    by_first: Array  # (B, m, d) in its chart
    by_second: Array  # (B, m, e)
    constant: Array  # (B, m) residuals where the charts begin, without what repeats
    slots: Index  # (B,)

    @classmethod
    def made(cls, of: Measured, begun: Slopes, here: Slopes) -> "LinearMeasurements":
        """With the slopes where charts have ``begun``, and what they are off at the estimate ``here``; without slots.

        So no two measurements differ in what a variable's change means: what turns the whole map turns none of them.
        """
        first, second = begun.by_first @ begun.first.slopes, begun.by_second @ begun.second.slopes
        moved = first @ here.first.steps[..., None] + second @ here.second.steps[..., None]
        constant, slots = here.residual - moved[..., 0], np.full(len(moved), -1)
        return cls(of=of, by_first=first, by_second=second, constant=constant, slots=slots)

    @property
    def kind(self) -> int:
        """0 of motions, and 1 of sightings."""
        return int(isinstance(self.of, Sightings))

    def off(self, slopes: Slopes) -> Array:
        """(B,) half the square of what each is off, at states with other ``slopes``, in standard deviations."""
        linear = self.by_first @ slopes.first.steps[..., None] + self.by_second @ slopes.second.steps[..., None]
        return 0.5 * squared_norms(slopes.residual - self.constant - linear[..., 0])

    def factors(self) -> gtsam.NonlinearFactorGraph:
        """One for GTSAM for each."""
        noise, right = unit_noise(self.constant.shape[1]), -(self.constant + self.of.offset)
        rows = zip(self.of.terms(), self.by_first, self.by_second, right, strict=True)
        linear = gtsam.GaussianFactorGraph()
        add: Any = linear.add  # of two or three keys, which its type does not say
        for (first, second, repeated), by_first, by_second, own in rows:
            add(first, by_first, second, by_second, *repeated, own, noise)
        return gtsam.LinearContainerFactor.ConvertLinearGraph(linear, gtsam.Values())


@dataclass(frozen=True, kw_only=True)
class LinearFactors:
    """All measurements of a smoother, in parts that are joined where they are asked for, and their charts."""

    charts: Charts
    model: ObservationModel
    num_slots: int  # for factors, of measurements and others, in iSAM2
    parts: tuple[tuple[LinearMeasurements, ...], ...] = ((), ())  # of motions, and of sightings

    @property
    def count(self) -> int:
        """Number of all measurements."""
        return sum(len(own.slots) for kind in self.parts for own in kind)

    def made(self, measured: Sequence[Measured], at: Located) -> list[LinearMeasurements]:
        """Measurements made linear in the charts, for estimates ``at``."""
        begun, spaces = self.charts.begun(), self.charts.spaces
        return [
            LinearMeasurements.made(own, *(own.measured(spaces, self.model, where) for where in (begun, at)))
            for own in measured
        ]

    def with_new(self, made: Sequence[LinearMeasurements], before: int, after: int = 0) -> "LinearFactors":
        """With measurements that iSAM2 was given after so many other factors ``before``, and ``after`` them."""
        parts, begin = list(self.parts), self.num_slots + before
        for own in made:
            end = begin + len(own.slots)
            parts[own.kind] = (*parts[own.kind], replace(own, slots=np.arange(begin, end)))
            begin = end
        return replace(self, parts=tuple(parts), num_slots=begin + after)

    def in_one_part(self) -> "LinearFactors":
        """Linear factors with each kind of measurement in one part."""
        return replace(self, parts=tuple((_joined(kind),) if kind else () for kind in self.parts))

    @property
    def joined(self) -> list[LinearMeasurements]:
        """All motions, and all sightings, where there are any."""
        return [_joined(kind) for kind in self.parts if kind]

    def off(self, at: Located) -> float:
        """Half the sum of squares of what all are off ``at`` an estimate, in standard deviations."""
        spaces = self.charts.spaces
        return float(sum(own.off(own.of.measured(spaces, self.model, at)).sum() for own in self.joined))

    def about(self, values: gtsam.Values) -> tuple["LinearFactors", list[LinearMeasurements]]:
        """Without measurements, charts about ``values``; and all measurements made linear there."""
        charts = Charts.of(self.charts.spaces, values)
        empty = LinearFactors(charts=charts, model=self.model, num_slots=0)
        return empty, empty.made([own.of.with_offsets(values.atVector) for own in self.joined], charts.begun())


def new_measurements(measured: Sequence[Measured], values: gtsam.Values, known: Mapping[int, Array]) -> list[Measured]:
    """Measurements with errors and biases where their charts are: new ones at ``values``, others ``known``."""

    def point(key: int) -> Array:
        return np.asarray(values.atVector(key)) if values.exists(key) else known[key]

    return [own.with_offsets(point) for own in measured]


def in_charts(factor: Any, charts: Charts, at: Located) -> Any:
    """A factor on robot and object that is linear in the tangent spaces where they are, in those of the charts."""
    keys = list(factor.keys())
    variables = [at.of(key) for key in keys]
    values = gtsam.Values()
    for key, own in zip(keys, variables, strict=True):
        charts.spaces.of(key).insert(values, key, own.states[0])
    jacobian, right = factor.linearize(values).jacobian()
    terms: list[Any] = []
    for key, own, block in zip(keys, variables, _blocks(jacobian, variables), strict=True):
        right = right + block @ own.slopes[0] @ own.steps[0]
        terms += [key, block @ own.slopes[0]]
    return gtsam.LinearContainerFactor(_jacobian_factor(*terms, right, unit_noise(len(right))), charts.points(keys))


def _blocks(jacobian: Array, variables: Sequence[Variables]) -> list[Array]:
    ends = np.cumsum([own.steps.shape[1] for own in variables])[:-1]
    return np.split(jacobian, ends, axis=1)


def _joined(parts: Sequence[LinearMeasurements]) -> LinearMeasurements:
    if len(parts) == 1:
        return parts[0]
    names = ("by_first", "by_second", "constant", "slots")
    rows = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return LinearMeasurements(of=_all([part.of for part in parts]), **rows)


def _all(parts: Sequence[Measured]) -> Measured:
    first = parts[0]
    if isinstance(first, Motions):
        return joined_rows(parts, ())
    seen = joined_rows([part.seen for part in parts if isinstance(part, Sightings)], ())
    return replace(joined_rows(parts, ("scale", "seen")), seen=seen)
