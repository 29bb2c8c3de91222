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
    y, enough = start.copy(), np.broadcast_to(tolerance, len(start))
    damping, growth = np.full(len(y), INITIAL_DAMPING), np.full(len(y), 2.0)
    running = np.arange(len(y))
    energy, gradient, hessian = (np.array(value) for value in stack.normal_equations(y))
    for _ in range(max_iterations):
        if len(running) == 0:
            break
        step, expected = _damped_step(hessian[running], gradient[running], damping[running])
        last = (expected < enough[running]) & (damping[running] < LAST_DAMPING)
        if last.any():  # what the quadratic model says is as good as looking
            y[running[last]] += step[last]
            energy[running[last]] -= expected[last]
            running, step, expected = running[~last], step[~last], expected[~last]
            if len(running) == 0:
                break
        trial = y[running] + step
        new_energy, new_gradient, new_hessian = stack.select(running).normal_equations(trial)
        gain = (energy[running] - new_energy) / np.maximum(expected, 1e-300)
        better = new_energy <= energy[running] + 1e-12 * np.abs(energy[running])
        accepted = running[better]
        y[accepted], energy[accepted] = trial[better], new_energy[better]
        gradient[accepted], hessian[accepted] = new_gradient[better], new_hessian[better]
        relaxed = np.maximum(1 / 3, 1 - (2 * np.minimum(gain, 1.0) - 1) ** 3)
        damping[running] *= np.where(better, relaxed, growth[running])
        growth[running] = np.where(better, 2.0, 2.0 * growth[running])
        small = (np.abs(step).max(-1) < STEP_TOLERANCE) | (better & (expected < enough[running]))
        running = running[~(small | (damping[running] > LARGEST_DAMPING))]
    return Mode(y, hessian, -energy - 0.5 * log_determinants(hessian))


def log_determinants(matrices: Array) -> Array:
    """(B,) of symmetric positive definite (B, n, n)."""
    root = np.linalg.cholesky(matrices)
    return np.asarray(2.0 * np.log(np.einsum("bii->bi", root)).sum(-1))


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
    added = damping[:, None] * np.einsum("bii->bi", hessian)
    damped = hessian.copy()
    np.einsum("bii->bi", damped)[...] += added
    step = np.asarray(-np.linalg.solve(damped, gradient[..., None])[..., 0], dtype=np.float64)
    return step, 0.5 * (step * (added * step - gradient)).sum(-1)
