"""Evidence of many small problems by a damped Laplace approximation around the mode.

With the prior whitened, psi = p(Z | y*) exp(-|y*|^2 / 2) det(H)^(-1/2), H = I + J^T J the Gauss-Newton Hessian at
the mode y*. Undamped Gauss-Newton loses the mode while the robot is lost; Levenberg-Marquardt keeps it.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from semantic_slam.inference.stack import Stack

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

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

    def select(self, selection: NDArray[np.int_]) -> "LeastSquares":
        """Some of the problems."""


@dataclass(frozen=True)
class Mode:
    """Mode and curvature of B problems."""

    y: Array  # (B, n) whitened
    hessian: Array  # (B, n, n)
    log_evidence: Array  # (B,) log of Eq. 4.20's integral without the observation model P(beta | x, O)

    def take(self, rows: NDArray[np.int_]) -> "Mode":
        """Some of the problems."""
        return Mode(self.y[rows], self.hessian[rows], self.log_evidence[rows])


def find_modes(
    stack: LeastSquares, start: Array, max_iterations: int = MAX_ITERATIONS, tolerance: float | Array = 0.0
) -> Mode:
    """Levenberg-Marquardt from ``start`` (B, n); rows that have converged are left alone.

    ``tolerance`` (B,): nats that a step may be expected to bring where a mode counts as found all the same.
    The damping follows the gain of each step (Nielsen, 1999): rows with large residuals settle at the damping
    they need instead of swinging about it.
    """
    search = _Search(stack, start, np.zeros(len(start)) + tolerance)
    for _ in range(max_iterations):
        if len(search.rows) == 0:
            break
        search.iterate()
    return search.found()


class _Search:
    """Problems that are still searched; what has converged is set aside."""

    def __init__(self, stack: LeastSquares, start: Array, enough: Array):
        self.rows = np.arange(len(start))
        self._stack, self._enough, self._y = stack, enough, start.copy()
        self._energy, self._gradient, self._hessian = (np.array(value) for value in stack.normal_equations(start))
        self._damping, self._growth = np.full(len(start), INITIAL_DAMPING), np.full(len(start), 2.0)
        self._ends = np.empty_like(self._y), np.empty_like(self._energy), np.empty_like(self._hessian)

    def found(self) -> Mode:
        """Of all problems, those still searched as they are."""
        self._end(np.ones(len(self.rows), dtype=bool))
        y, energy, hessian = self._ends
        return Mode(y, hessian, -energy - 0.5 * log_determinants(hessian))

    def iterate(self) -> None:
        """One step of each."""
        step, expected = _damped_step(self._hessian, self._gradient, self._damping)
        last = (expected < self._enough) & (self._damping < LAST_DAMPING)
        if last.any():  # what the quadratic model says is as good as looking
            self._y[last] += step[last]
            self._energy[last] -= expected[last]
            self._end(last)
            step, expected = step[~last], expected[~last]
            if len(self.rows) == 0:
                return
        trial = self._y + step
        energy, gradient, hessian = self._stack.normal_equations(trial)
        gain = (self._energy - energy) / np.maximum(expected, 1e-300)
        better = energy <= self._energy + 1e-12 * np.abs(self._energy)
        self._accept(better, trial, energy, gradient, hessian)
        relaxed = np.maximum(1 / 3, 1 - (2 * np.minimum(gain, 1.0) - 1) ** 3)
        self._damping *= np.where(better, relaxed, self._growth)
        self._growth = np.where(better, 2.0, 2.0 * self._growth)
        small = (np.abs(step).max(-1) < STEP_TOLERANCE) | (better & (expected < self._enough))
        self._end(small | (self._damping > LARGEST_DAMPING))

    def _accept(self, better: Flags, y: Array, energy: Array, gradient: Array, hessian: Array) -> None:
        if better.all():
            self._y, self._energy, self._gradient, self._hessian = y, energy, gradient, hessian
            return
        self._y[better], self._energy[better] = y[better], energy[better]
        self._gradient[better], self._hessian[better] = gradient[better], hessian[better]

    def _end(self, ended: Flags) -> None:
        if not ended.any():
            return
        at = self.rows[ended]
        for end, own in zip(self._ends, (self._y, self._energy, self._hessian), strict=True):
            end[at] = own[ended]
        going = np.flatnonzero(~ended)
        self.rows, self._stack, self._enough = self.rows[going], self._stack.select(going), self._enough[going]
        self._y, self._energy, self._gradient = self._y[going], self._energy[going], self._gradient[going]
        self._hessian, self._damping, self._growth = self._hessian[going], self._damping[going], self._growth[going]


def log_determinants(matrices: Array) -> Array:
    """(B,) of symmetric positive definite (B, n, n)."""
    return np.asarray(2.0 * np.log(_diagonals(np.asarray(np.linalg.cholesky(matrices)))).sum(-1))


def search_start(stack: Stack) -> Array:
    """(B, n) the best of the prior mean and the robot states that explain one detection each."""
    best = np.zeros((len(stack.mean), stack.size))
    if len(best) == 0:
        return best
    least = stack.energy(best)
    dimension = stack.dimension
    robot = stack.mean[:, 0]
    for number in range(stack.rows.objects.shape[1]):
        wanted = stack.model.robot_start(stack.seen.take([number]), robot, stack.objects_of(stack.mean, number))
        start = np.zeros_like(best)
        tangent = stack.manifold.local(robot, wanted)
        start[:, :dimension] = np.linalg.solve(stack.root[:, :dimension, :dimension], tangent[..., None])[..., 0]
        energy = np.where(stack.active[:, number], stack.energy(start), np.inf)
        better = energy < least
        best[better], least = start[better], np.minimum(least, energy)
    return best


def _damped_step(hessian: Array, gradient: Array, damping: Array) -> tuple[Array, Array]:
    """(B, n) step and (B,) decrease of the energy that the quadratic model expects of it."""
    damped = hessian.copy()
    added = damping[:, None] * _diagonals(hessian)
    _diagonals(damped)[...] += added
    step = np.asarray(-np.linalg.solve(damped, gradient[..., None])[..., 0], dtype=np.float64)
    return step, 0.5 * (step * (added * step - gradient)).sum(-1)


def _diagonals(matrices: Array) -> Array:
    """(B, n) of contiguous (B, n, n), to write to as well."""
    return matrices.reshape(len(matrices), matrices.shape[1] ** 2)[:, :: matrices.shape[1] + 1]
