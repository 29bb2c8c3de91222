"""Evidence of many small problems by the Laplace approximation at the mode.

With the prior whitened, psi = p(Z | y*) exp(-|y*|^2 / 2) det(H)^(-1/2), H = I + J^T J the Gauss-Newton Hessian at
the mode y*. Undamped Gauss-Newton diverges from the mode while the robot is lost, Levenberg-Marquardt does not. Where
it stops, at a whitened step of its tolerance, the log evidence is accurate to about 1e-5.
"""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array, Index, diagonals, row_sums
from semantic_slam.geometry.levenberg_marquardt import MAX_ITERATIONS, LeastSquares, Minimum, minimise
from semantic_slam.geometry.rows import take

RANKING_ITERATIONS = 12
"""Iterations for modes that only rank partial associations: those near the best have converged by then."""
RANKING_TOLERANCE = 0.3
"""Convergence tolerance of modes that only rank: largest expected gain of the last step, in nats."""
WEIGHING_TOLERANCE = 1e-3
"""Convergence tolerance where the evidence at the mode is a weight: largest expected gain of the last step, in nats."""


@dataclass(frozen=True)
class Mode:
    """Modes, Hessians and Laplace evidences of B problems."""

    y: Array  # (B, n) whitened
    hessian: Array  # (B, n, n)
    log_evidence: Array  # (B,) log of Eq. 4.20's integral without the observation model P(beta | x, O)

    def take(self, rows: Index) -> "Mode":
        """Modes of the chosen problems."""
        return take(self, rows)


def find_modes(
    problems: LeastSquares, start: Array, max_iterations: int = MAX_ITERATIONS, tolerance: float | Array = 0.0
) -> Mode:
    """Search modes from ``start`` (B, n) and compute their evidences; ``tolerance`` (B,) in nats."""
    return mode_at(minimise(problems, start, max_iterations, tolerance))


def mode_at(minimum: Minimum) -> Mode:
    """The Laplace evidences at minima of the energy."""
    log_evidence = -minimum.energy - 0.5 * log_determinants(minimum.hessian)
    return Mode(minimum.y, minimum.hessian, log_evidence)


def log_determinants(matrices: Array) -> Array:
    """(B,) log determinants of symmetric positive definite matrices (B, n, n)."""
    return 2.0 * row_sums(np.log(diagonals(np.asarray(np.linalg.cholesky(matrices)))))
