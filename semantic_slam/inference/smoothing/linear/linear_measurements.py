"""Measurements as iSAM2 holds them: linear in its charts, each with its factor slot there."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array, Index, squared_norms
from semantic_slam.inference.models.linear_factors import unit_noise
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.smoothing.linear.charts import Charts
from semantic_slam.inference.smoothing.linear.located import Located, Stepped
from semantic_slam.inference.smoothing.linear.measured import Measured, Sightings, Slopes, joined

_jacobian_factor: Any = gtsam.JacobianFactor  # of two or three keys, which its type does not say


@dataclass(frozen=True, kw_only=True)
class LinearMeasurements:
    """B measurements of one kind, m components each, of variables of d and e dimensions."""

    of: Measured  # B
    by_first: Array  # (B, m, d) in its chart
    by_second: Array  # (B, m, e)
    constant: Array  # (B, m) residuals at the base points, without biases and correlated errors
    slots: Index  # (B,)

    @classmethod
    def made(cls, of: Measured, begun: Slopes, here: Slopes) -> "LinearMeasurements":
        """Measurements with Jacobians at the base points (``begun``), and residuals that fit the estimate (``here``).

        They have no slots yet. All share Jacobians at the base points, so that a rotation of the whole map is
        unobservable in each of them.
        """
        first, second = begun.by_first @ begun.first.slopes, begun.by_second @ begun.second.slopes
        moved = first @ here.first.steps[..., None] + second @ here.second.steps[..., None]
        constant, slots = here.residual - moved[..., 0], np.full(len(moved), -1)
        return cls(of=of, by_first=first, by_second=second, constant=constant, slots=slots)

    @property
    def kind(self) -> int:
        """0 for motions, and 1 for sightings."""
        return int(isinstance(self.of, Sightings))

    def part(self, of: Measured, rows: Index) -> "LinearMeasurements":
        """Some ``rows``, which are the measurements ``of``."""
        return LinearMeasurements(
            of=of,
            by_first=self.by_first[rows],
            by_second=self.by_second[rows],
            constant=self.constant[rows],
            slots=self.slots[rows],
        )

    def off(self, slopes: Slopes) -> Array:
        """(B,) half the squared linearisation error of each, in standard deviations, at states with new ``slopes``."""
        linear = self.by_first @ slopes.first.steps[..., None] + self.by_second @ slopes.second.steps[..., None]
        return 0.5 * squared_norms(slopes.residual - self.constant - linear[..., 0])

    def factors(self) -> gtsam.NonlinearFactorGraph:
        """GTSAM factors, one for each measurement."""
        noise, right = unit_noise(self.constant.shape[1]), -(self.constant + self.of.offset)
        rows = zip(self.of.terms(), self.by_first, self.by_second, right, strict=True)
        linear = gtsam.GaussianFactorGraph()
        add: Any = linear.add  # of two or three keys, which its type does not say
        for (first, second, repeated), by_first, by_second, own in rows:
            add(first, by_first, second, by_second, *repeated, own, noise)
        return gtsam.LinearContainerFactor.ConvertLinearGraph(linear, gtsam.Values())


@dataclass(frozen=True, kw_only=True)
class LinearFactors:
    """All measurements of a smoother and their charts; batches are joined on demand."""

    charts: Charts
    model: ObservationModel
    num_slots: int  # factor slots in iSAM2, of measurements and others
    parts: tuple[tuple[LinearMeasurements, ...], ...] = ((), ())  # of motions, and of sightings

    @property
    def count(self) -> int:
        """Number of measurements."""
        return sum(len(own.slots) for kind in self.parts for own in kind)

    def with_new(self, made: Sequence[LinearMeasurements], before: int, after: int = 0) -> "LinearFactors":
        """With measurements that iSAM2 received after ``before`` other new factors and before ``after`` more."""
        parts, begin = list(self.parts), self.num_slots + before
        for own in made:
            end = begin + len(own.slots)
            parts[own.kind] = (*parts[own.kind], replace(own, slots=np.arange(begin, end)))
            begin = end
        return replace(self, parts=tuple(parts), num_slots=begin + after)

    def in_one_part(self) -> "LinearFactors":
        """Linear factors with each kind of measurement in one batch."""
        return replace(self, parts=tuple((_joined(kind),) if kind else () for kind in self.parts))

    @property
    def joined(self) -> list[LinearMeasurements]:
        """All motions in one batch, and all sightings in one, where there are any."""
        return [_joined(kind) for kind in self.parts if kind]

    def off(self, at: Located) -> float:
        """Half the squared linearisation error of all measurements at an estimate, in standard deviations."""
        spaces = self.charts.spaces
        return float(sum(own.off(own.of.measured(spaces, self.model, *own.of.sides(at))).sum() for own in self.joined))

    def about(self, values: gtsam.Values) -> tuple["LinearFactors", list[LinearMeasurements]]:
        """Empty linear factors with charts about ``values``, and all measurements linearised there."""
        charts = Charts.of(self.charts.spaces, values)
        begun, made = charts.begun(), []
        for own in self.joined:
            of = own.of.with_offsets(values.atVector)
            slopes = of.measured(charts.spaces, self.model, *of.sides(begun))
            made.append(LinearMeasurements.made(of, slopes, slopes))
        return LinearFactors(charts=charts, model=self.model, num_slots=0), made


def in_charts(factor: Any, charts: Charts, at: Located) -> Any:
    """A linear factor on robot and object, transformed from tangent spaces at the estimates to the charts."""
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


def _blocks(jacobian: Array, variables: Sequence[Stepped]) -> list[Array]:
    ends = np.cumsum([own.steps.shape[1] for own in variables])[:-1]
    return np.split(jacobian, ends, axis=1)


def _joined(parts: Sequence[LinearMeasurements]) -> LinearMeasurements:
    if len(parts) == 1:
        return parts[0]
    names = ("by_first", "by_second", "constant", "slots")
    rows = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return LinearMeasurements(of=joined([part.of for part in parts]), **rows)
