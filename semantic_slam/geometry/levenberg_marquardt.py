"""Batched Levenberg-Marquardt: many small problems at once, each with its own damping.

Undamped Gauss-Newton diverges where residuals are large or the start is far from the minimum. The damping follows the
gain ratio of each step (Nielsen, 1999), so that problems with large residuals converge at the damping they need
instead of oscillating around it.
"""

import copy
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index, diagonals

MAX_ITERATIONS = 30
STEP_TOLERANCE = 1e-5
"""Step length, in coordinates of unit scale, below which a minimum counts as found."""
INITIAL_DAMPING = 1e-4
LARGEST_DAMPING = 1e12
"""Damping beyond which no step helps any more."""
LAST_DAMPING = 0.1
"""Damping below which a step with a negligible expected decrease counts as having reached the minimum."""


class LeastSquares(Protocol):
    """The energies of B problems of n unknowns, in coordinates of about unit scale."""

    def normal_equations(self, y: Array) -> tuple[Array, Array, Array]:
        """Energy (B,), gradient (B, n) and Gauss-Newton Hessian (B, n, n) at ``y`` (B, n)."""

    def select(self, selection: Index) -> "LeastSquares":
        """The selected problems of the batch."""


@dataclass(frozen=True)
class Minimum:
    """Current or final state of the minimisation of B problems."""

    y: Array  # (B, n)
    energy: Array  # (B,)
    hessian: Array  # (B, n, n) Gauss-Newton

    def or_lower(self, other: "Minimum") -> "Minimum":
        """For each problem the minimum with the lower energy."""
        lower = other.energy < self.energy
        return Minimum(
            np.where(lower[:, None], other.y, self.y),
            np.where(lower, other.energy, self.energy),
            np.where(lower[:, None, None], other.hessian, self.hessian),
        )


def minimise(
    problems: LeastSquares, start: Array, max_iterations: int = MAX_ITERATIONS, tolerance: float | Array = 0.0
) -> Minimum:
    """Levenberg-Marquardt from ``start`` (B, n); see :meth:`LevenbergMarquardt.finished`."""
    return LevenbergMarquardt(problems, start).finished(max_iterations, tolerance)


class LevenbergMarquardt:
    """State of a running minimisation of B problems."""

    def __init__(self, problems: LeastSquares, start: Array):
        self._problems, self.y = problems, start.copy()
        self.energy, self._gradient, self.hessian = (np.array(value) for value in problems.normal_equations(start))
        self.damping, self._growth = np.full(len(start), INITIAL_DAMPING), np.full(len(start), 2.0)

    def select(self, rows: Index) -> "LevenbergMarquardt":
        """The minimisation of the selected problems alone, continued from their current states."""
        part = copy.copy(self)
        part._problems = self._problems.select(rows)
        part.y, part.energy, part._gradient = self.y[rows], self.energy[rows], self._gradient[rows]
        part.hessian, part.damping, part._growth = self.hessian[rows], self.damping[rows], self._growth[rows]
        return part

    def take_lower(self, other: "LevenbergMarquardt") -> None:
        """Continue from where another minimisation of the problems stands, for those whose energy is lower there."""
        rows = np.flatnonzero(other.energy < self.energy)
        self.y[rows], self.energy[rows] = other.y[rows], other.energy[rows]
        self._gradient[rows], self.hessian[rows] = other._gradient[rows], other.hessian[rows]
        self.damping[rows], self._growth[rows] = other.damping[rows], other._growth[rows]

    def reached(self) -> Minimum:
        """Lowest energies so far, and the points where they are reached."""
        return Minimum(self.y.copy(), self.energy.copy(), self.hessian.copy())

    def advance(self, iterations: int, enough: Array) -> None:
        """Take ``iterations`` steps per problem; fewer once the next is expected to gain less than ``enough`` (B,)."""
        for _ in range(iterations):
            step, expected = self.next_step()
            near = self.is_near(expected, enough)
            if near.all():
                return
            there = np.flatnonzero(near)
            step[there] = 0.0
            damping, growth = self.damping[there], self._growth[there]
            self.step(step, expected)
            self.damping[there], self._growth[there] = damping, growth

    def finished(self, max_iterations: int = MAX_ITERATIONS, tolerance: float | Array = 0.0) -> Minimum:
        """Minimum after at most ``max_iterations`` steps; converged problems are left out. Consumes this object.

        ``tolerance`` (B,): expected decrease of a step below which the minimum counts as found.
        """
        count = len(self.y)
        ends = np.empty_like(self.y), np.empty_like(self.energy), np.empty_like(self.hessian)
        finish = _Finish(self, np.arange(count), np.zeros(count) + tolerance, ends)
        for _ in range(max_iterations):
            if not len(finish.rows):
                break
            finish.iterate()
        finish.set_aside(np.ones(len(finish.rows), dtype=bool))
        y, energy, hessian = ends
        return Minimum(y, energy, hessian)

    def next_step(self) -> tuple[Array, Array]:
        """(B, n) damped step, and (B,) energy decrease that the quadratic model predicts for it."""
        damped = self.hessian.copy()
        added = self.damping[:, None] * diagonals(self.hessian)
        diagonals(damped)[...] += added
        step = np.asarray(-np.linalg.solve(damped, self._gradient[..., None])[..., 0], dtype=np.float64)
        return step, 0.5 * np.asarray(np.vecdot(step, added * step - self._gradient))

    def is_near(self, expected: Array, enough: Array) -> Flags:
        """(B,) whether the next step reaches the minimum, judged by its expected decrease and the damping."""
        return np.asarray((expected < enough) & (self.damping < LAST_DAMPING))

    def step(self, step: Array, expected: Array) -> Flags:
        """Try one step of each problem; returns (B,) whether it was accepted. Rejected ones stay where they are."""
        trial = self.y + step
        energy, gradient, hessian = self._problems.normal_equations(trial)
        gain = (self.energy - energy) / np.maximum(expected, 1e-300)
        better = np.asarray(energy <= self.energy + 1e-12 * np.abs(self.energy))
        if better.all():
            self.y, self.energy, self._gradient, self.hessian = trial, energy, gradient, hessian
        else:
            self.y[better], self.energy[better] = trial[better], energy[better]
            self._gradient[better], self.hessian[better] = gradient[better], hessian[better]
        beyond = 2.0 * np.minimum(gain, 1.0) - 1.0
        relaxed = np.maximum(1.0 / 3.0, 1.0 - beyond * beyond * beyond)
        self.damping *= np.where(better, relaxed, self._growth)
        self._growth = np.where(better, 2.0, 2.0 * self._growth)
        return better


@dataclass
class _Finish:
    """Problems still being minimised; converged ones are set aside."""

    search: LevenbergMarquardt
    rows: Index  # (B,) indices among all problems
    enough: Array  # (B,)
    ends: tuple[Array, Array, Array]  # y, energies and Hessians of all problems

    def iterate(self) -> None:
        """One step of each."""
        step, expected = self.search.next_step()
        last = self.search.is_near(expected, self.enough)
        if last.any():  # accept the quadratic model's prediction without evaluating
            self.search.y[last] += step[last]
            self.search.energy[last] -= expected[last]
            self.set_aside(last)
            step, expected = step[~last], expected[~last]
            if not len(self.rows):
                return
        better = self.search.step(step, expected)
        small = (np.abs(step).max(-1) < STEP_TOLERANCE) | (better & (expected < self.enough))
        self.set_aside(small | (self.search.damping > LARGEST_DAMPING))

    def set_aside(self, ended: Flags) -> None:
        """Store the results of finished problems and continue with the others."""
        if not ended.any():
            return
        at, search = self.rows[ended], self.search
        for end, own in zip(self.ends, (search.y, search.energy, search.hessian), strict=True):
            end[at] = own[ended]
        left = np.flatnonzero(~ended)
        self.search, self.rows, self.enough = search.select(left), self.rows[left], self.enough[left]
