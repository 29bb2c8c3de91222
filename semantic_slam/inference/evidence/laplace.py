"""Evidence of many small problems by a damped Laplace approximation around the mode.

With the prior whitened, psi = p(Z | y*) exp(-|y*|^2 / 2) det(H)^(-1/2), H = I + J^T J the Gauss-Newton Hessian at
the mode y*. Undamped Gauss-Newton loses the mode while the robot is lost; Levenberg-Marquardt keeps it.
"""

import copy
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index, row_sums

MAX_ITERATIONS = 30
RANKING_ITERATIONS = 12
"""For modes that only rank partial associations: those near the best have converged by then."""
RANKING_TOLERANCE = 0.3
"""Nats that the last step may have been expected to bring at a mode that only ranks; what is left then is less."""
WEIGHING_TOLERANCE = 1e-3
"""The same where the evidence at the mode is a weight."""
STEP_TOLERANCE = 1e-5
"""Whitened step at which a mode counts as found: log evidence is then exact to about 1e-5."""
INITIAL_DAMPING = 1e-4
LARGEST_DAMPING = 1e12
LAST_DAMPING = 0.1
"""Damping up to which a step that is expected to bring next to nothing ends at the mode."""


class LeastSquares(Protocol):
    """The energies of B problems in whitened coordinates."""

    def normal_equations(self, y: Array) -> tuple[Array, Array, Array]:
        """Energy (B,), gradient (B, n) and Gauss-Newton Hessian (B, n, n)."""

    def select(self, selection: Index) -> "LeastSquares":
        """Some of the problems."""


@dataclass(frozen=True)
class Mode:
    """Mode and curvature of B problems."""

    y: Array  # (B, n) whitened
    hessian: Array  # (B, n, n)
    log_evidence: Array  # (B,) log of Eq. 4.20's integral without the observation model P(beta | x, O)

    def take(self, rows: Index) -> "Mode":
        """Some of the problems."""
        return Mode(self.y[rows], self.hessian[rows], self.log_evidence[rows])


def find_modes(
    stack: LeastSquares, start: Array, max_iterations: int = MAX_ITERATIONS, tolerance: float | Array = 0.0
) -> Mode:
    """Levenberg-Marquardt from ``start`` (B, n); see :meth:`LevenbergMarquardt.finished`."""
    return LevenbergMarquardt(stack, start).finished(max_iterations, tolerance)


class LevenbergMarquardt:
    """B problems on their way to their modes.

    The damping follows the gain of each step (Nielsen, 1999): rows with large residuals settle at the damping
    they need instead of swinging about it.
    """

    def __init__(self, stack: LeastSquares, start: Array):
        self._stack, self.y = stack, start.copy()
        self.energy, self._gradient, self.hessian = (np.array(value) for value in stack.normal_equations(start))
        self.damping, self._growth = np.full(len(start), INITIAL_DAMPING), np.full(len(start), 2.0)

    def select(self, rows: Index) -> "LevenbergMarquardt":
        """Some of the problems, where they are."""
        part = copy.copy(self)
        part._stack = self._stack.select(rows)
        part.y, part.energy, part._gradient = self.y[rows], self.energy[rows], self._gradient[rows]
        part.hessian, part.damping, part._growth = self.hessian[rows], self.damping[rows], self._growth[rows]
        return part

    def mode(self) -> Mode:
        """Of all problems, where they are."""
        return Mode(self.y.copy(), self.hessian.copy(), -self.energy - 0.5 * log_determinants(self.hessian))

    def advance(self, iterations: int, enough: Array) -> None:
        """So many steps of each problem; fewer once its next one is not expected to bring ``enough`` (B,) nats."""
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

    def finished(self, max_iterations: int = MAX_ITERATIONS, tolerance: float | Array = 0.0) -> Mode:
        """After that many steps at most; problems that have converged are left alone. Uses up this descent.

        ``tolerance`` (B,): nats that a step may be expected to bring where a mode counts as found all the same.
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
        return Mode(y, hessian, -energy - 0.5 * log_determinants(hessian))

    def next_step(self) -> tuple[Array, Array]:
        """(B, n) damped step and (B,) decrease of the energy that the quadratic model expects of it."""
        damped = self.hessian.copy()
        added = self.damping[:, None] * _diagonals(self.hessian)
        _diagonals(damped)[...] += added
        step = np.asarray(-np.linalg.solve(damped, self._gradient[..., None])[..., 0], dtype=np.float64)
        return step, 0.5 * np.asarray(np.vecdot(step, added * step - self._gradient))

    def is_near(self, expected: Array, enough: Array) -> Flags:
        """(B,) whether the next step ends at the mode."""
        return np.asarray((expected < enough) & (self.damping < LAST_DAMPING))

    def step(self, step: Array, expected: Array) -> Flags:
        """One step of each; (B,) whether it is better there, for others stay where they are."""
        trial = self.y + step
        energy, gradient, hessian = self._stack.normal_equations(trial)
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
    """Problems that are still searched; what has converged is set aside."""

    descent: LevenbergMarquardt
    rows: Index  # (B,) of all problems
    enough: Array  # (B,)
    ends: tuple[Array, Array, Array]  # y, energies and Hessians of all problems

    def iterate(self) -> None:
        """One step of each."""
        step, expected = self.descent.next_step()
        last = self.descent.is_near(expected, self.enough)
        if last.any():  # what the quadratic model says is as good as looking
            self.descent.y[last] += step[last]
            self.descent.energy[last] -= expected[last]
            self.set_aside(last)
            step, expected = step[~last], expected[~last]
            if not len(self.rows):
                return
        better = self.descent.step(step, expected)
        small = (np.abs(step).max(-1) < STEP_TOLERANCE) | (better & (expected < self.enough))
        self.set_aside(small | (self.descent.damping > LARGEST_DAMPING))

    def set_aside(self, ended: Flags) -> None:
        """Where they are."""
        if not ended.any():
            return
        at, descent = self.rows[ended], self.descent
        for end, own in zip(self.ends, (descent.y, descent.energy, descent.hessian), strict=True):
            end[at] = own[ended]
        left = np.flatnonzero(~ended)
        self.descent, self.rows, self.enough = descent.select(left), self.rows[left], self.enough[left]


def log_determinants(matrices: Array) -> Array:
    """(B,) of symmetric positive definite (B, n, n)."""
    return 2.0 * row_sums(np.log(_diagonals(np.asarray(np.linalg.cholesky(matrices)))))


def _diagonals(matrices: Array) -> Array:
    """(B, n) of contiguous (B, n, n), to write to as well."""
    return matrices.reshape(len(matrices), matrices.shape[1] ** 2)[:, :: matrices.shape[1] + 1]
