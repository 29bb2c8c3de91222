"""Joint Gaussian of the positions of all runs, from which the evidence of every grouping into objects follows.

All is linearised at one solution: near it, the evidence of a history whose objects are other unions of the runs has a
closed form.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.linalg import solve_triangular

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.revision.returns.runs import Runs
from semantic_slam.inference.revision.returns.solution import Solution, System
from semantic_slam.inference.revision.returns.whole_drive import WholeDrive


@dataclass(frozen=True, kw_only=True)
class RunModel:
    """A quadratic in the positions of A atoms: error = constant + slope places + places information places / 2."""

    information: Array  # (2 A, 2 A)
    slope: Array  # (2 A,)
    constant: float  # with path and biases integrated out

    @classmethod
    def at(cls, drive: WholeDrive, runs: Runs, solution: Solution, objects: Index) -> Self:
        """Linearised at a solution in which the atoms are of ``objects`` (A,), 0 to N - 1."""
        places = solution.places[objects]
        system = System(drive, runs.detections, solution.path, solution.biases, places)
        matrix, slope = system.matrix, system.slope
        rest = len(slope) - places.size
        root = np.linalg.cholesky(matrix[:rest, :rest])
        white = solve_triangular(root, np.column_stack([matrix[:rest, rest:], slope[:rest]]), lower=True)
        across, along = white[:, :-1], white[:, -1]
        information = matrix[rest:, rest:] - across.T @ across
        at = places.ravel()
        own = slope[rest:] - across.T @ along
        constant = system.error - 0.5 * along @ along - own @ at + 0.5 * at @ information @ at
        log_determinant = 2.0 * float(np.log(np.diagonal(root)).sum())
        return cls(
            information=information,
            slope=own - information @ at,
            constant=float(constant) + 0.5 * log_determinant,
        )

    def log_evidence(self, objects: Index) -> float:
        """Log evidence of atoms of ``objects`` (A,), 0 to N - 1, with one object per square metre a priori."""
        union = np.kron(np.eye(int(objects.max()) + 1)[objects], np.eye(2))
        root = np.linalg.cholesky(union.T @ self.information @ union)
        white = solve_triangular(root, union.T @ self.slope, lower=True)
        log_determinant = float(np.log(np.diagonal(root)).sum())
        return float(0.5 * white @ white - log_determinant + 0.5 * len(root) * np.log(2.0 * np.pi)) - self.constant
